"""Join parts that hang in the air with the parts that hold them, in one view: screen and foot, lid and base.

A part hangs if it begins well above the support, its bottom is not hidden by something in front, and no part beneath
reaches up to it. What holds it is not seen: it is behind the part, or in a hole of depth. The part belongs to the one
that stands beneath it. If air is seen beneath it, it also belongs to a part that reaches up beside it (a screen, from
behind, to its neck), or that it would fall off, since its middle is not above it (a pan's handle to the pan). A part
may also rest on something too long for an object, such as a shelf.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.quantiles import quantiles
from spot3d.geometry.standing import is_below_camera
from spot3d.geometry.upright import taken
from spot3d.kernel import kernel

# With each of these from half to twice its value success and detection of single frames on HOTS, OSD and 60 cluttered
# frames are the same, within 0.006 and 0.000. Only `_BESIDE` of 0.06 joins objects that stand close (cluttered: 0.86,
# 0.87 to 0.84, 0.83). Without this step HOTS falls from 0.92, 0.92 to 0.85, 0.90; the others stay.
STANDS = 0.03
"""A part that begins within this height above a support or a carrier stands on it, metres: depth misses its rim, and is
noisy."""
_BESIDE = 0.03
"""The holder of a part lies beneath it, or this near, seen from above, metres: the depth of an edge wanders."""
_TOUCHES = 0.01
"""Parts this near touch, metres: some pixels, or the noise of two. Detection on six rendered workbenches and six
kitchen counters that are not built in: 0.91 and 0.79 if a part joins one that it touches and would fall off, 0.88 and
0.77 if not. With 0.03 near desks, shaken or with skipped frames, lose a screen. Detection on three of these counters
and three with a sink: 0.83 and 0.76 if a part in front of its holder would fall off as well, at once or from 1 or 3 cm
on, 0.77 and 0.69 if only one beside it would."""
_IN_FRONT = 0.02
"""A pixel this much nearer than its neighbour hides what is behind, metres."""
_LOW, _HIDDEN = 0.25, 0.5
"""The bottom of a part is hidden if more than this share of its lower edge, in its lower quarter, is behind something
in front or at the image's border. With 0.25 and 0.75 it is the same. If nine tenths of its whole edge had to be seen,
screens behind something else would be split from their feet (two of four on rendered desks)."""
_AIR = 0.5
"""If something farther away is seen beneath more than this share of the lower edge, air and no hole in depth separates
the part from the support. With 0.25 and 0.75 it is the same. If no part joins one that reaches up to it, three of five
screens that are seen from all sides are in pieces."""
_END = 0.02
"""Share of a part's points that may lie beyond its top and its bottom."""
_SAMPLE = 300
"""About this many of a part's points are compared with those of other parts."""
_NOTHING = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """pixels: (n,) flat indices; plan: (m, 3) float32, some of their points, projected along up to one height; low,
    high: (3,) corners of the plan; bottom, top: heights above the support; metres."""

    pixels: NDArray[np.int64]
    plan: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    bottom: float
    top: float


def join_hanging(
    parts: list[NDArray[np.int64]],
    points: NDArray[np.float32],
    height: NDArray[np.float32],
    up: NDArray[np.float64],
    carriers: NDArray[np.int64] = _NOTHING,
) -> list[NDArray[np.int64]]:
    """The parts of one view after joining those that hang in the air with the part beneath them.

    parts: flat pixel indices; points: (h, w, 3) float32 metres, camera frame; height: (h * w,) float32 metres above
    the support; up: (3,) unit, camera frame; carriers: flat pixel indices of what is too long for an object. A part
    that hangs above nothing stays as it is.
    """
    flat, depth = points.reshape(-1, 3), np.ascontiguousarray(points[..., 2])
    known = [_part(pixels, flat, height, up) for pixels in parts]
    held: dict[int, list[NDArray[np.int64]]] = {k: [part.pixels] for k, part in enumerate(known)}
    for k, part in enumerate(known):
        if part.bottom < STANDS or is_below_camera(taken(flat, part.pixels), up):
            continue
        hidden, air = _beneath(part, depth, height, up)
        across = _across(part, flat, up) if air > _AIR else None
        holder = _holder(part, known, across, up) if hidden <= _HIDDEN else None
        if holder is not None and not _is_carried(part, carriers, flat, height, up):
            held[holder] += held.pop(k)  # a holder never hangs itself
    return [np.concatenate(pixels) for pixels in held.values()]


def _part(
    pixels: NDArray[np.int64], flat: NDArray[np.float32], height: NDArray[np.float32], up: NDArray[np.float64]
) -> _Part:
    bottom, top = quantiles(height[pixels], _END, 1 - _END)
    plan = _in_plan(flat, pixels[:: max(1, len(pixels) // _SAMPLE)], up)
    axes = np.ascontiguousarray(plan.T)
    return _Part(pixels, plan, axes.min(axis=1), axes.max(axis=1), float(bottom), float(top))


def _in_plan(flat: NDArray[np.float32], pixels: NDArray[np.int64], up: NDArray[np.float64]) -> NDArray[np.float32]:
    """(n, 3) float32: these pixels' points, projected along up to one height."""
    upwards, places = up.astype(np.float32), taken(flat, pixels)
    plan: NDArray[np.float32] = places - (places @ upwards)[:, None] * upwards
    return plan


def _is_carried(
    part: _Part,
    carriers: NDArray[np.int64],
    flat: NDArray[np.float32],
    height: NDArray[np.float32],
    up: NDArray[np.float64],
) -> bool:
    """Whether some of the carriers' pixels are at the bottom of a part."""
    plan = _in_plan(flat, carriers[np.abs(height[carriers] - part.bottom) < STANDS], up)
    near = ((plan > part.low - _BESIDE) & (plan < part.high + _BESIDE)).all(axis=1)
    return bool(_square(part.plan, plan[near]) < _BESIDE**2)


def _across(part: _Part, flat: NDArray[np.float32], up: NDArray[np.float64]) -> NDArray[np.float32]:
    """(3,) unit: the level direction across the view of a part. A part's extent along it is seen whole, however little
    of its depth is."""
    across = np.cross(taken(flat, part.pixels).mean(axis=0, dtype=np.float64), up)
    return np.asarray(across / np.linalg.norm(across), np.float32)


def _is_above(part: _Part, other: _Part, across: NDArray[np.float32], up: NDArray[np.float64]) -> bool:
    """Whether a part's middle is above another part: within its extent across the view, and not in front of it."""
    own, below = part.plan @ across, other.plan @ across
    if not below.min() <= (own.min() + own.max()) / 2 <= below.max():
        return False
    ahead = np.cross(up, across).astype(np.float32)
    own, below = part.plan @ ahead, other.plan @ ahead
    return bool((own.min() + own.max()) / 2 > below.min() - _BESIDE)


def _holder(
    part: _Part, others: list[_Part], across: NDArray[np.float32] | None, up: NDArray[np.float64]
) -> int | None:
    """The number of the part that stands beneath a part or, if that is seen to be in the air, beside its lower end.

    across: see `_across`; None if the part is not seen to be in the air. Returns None if there is no such part, if the
    part may rest on another one, or if one reaches up to it that it may stand beside.
    """
    found, nearest = None, _BESIDE
    for number, other in enumerate(others):
        if other is part or other.bottom >= part.bottom:
            continue
        if (np.maximum(part.low - other.high, other.low - part.high) >= _BESIDE).any():
            continue
        away = float(np.sqrt(_square(part.plan, other.plan)))
        reaches, passes = other.top > part.bottom - STANDS, other.top > part.bottom + STANDS
        held = across is not None and (passes or (away < _TOUCHES and not _is_above(part, other, across, up)))
        if away < _BESIDE and reaches and not held:
            return None
        if away < nearest and other.bottom < STANDS:
            found, nearest = number, away
    return found


def _beneath(
    part: _Part, depth: NDArray[np.float32], height: NDArray[np.float32], up: NDArray[np.float64]
) -> tuple[float, float]:
    """The shares of a part's lower edge that something in front or the image's border hides, and beneath which
    something farther away is seen.

    depth: (h, w) metres; height: (h * w,); up: (3,) unit, camera frame.
    """
    (h, w), own = depth.shape, np.zeros(depth.size, np.bool_)
    own[part.pixels] = True
    low = part.pixels[height[part.pixels] < part.bottom + _LOW * (part.top - part.bottom)]
    v, u = np.divmod(low, w)
    if abs(up[1]) >= abs(up[0]):
        v = v - int(np.sign(up[1]))
    else:
        u = u - int(np.sign(up[0]))
    cut = (v < 0) | (v >= h) | (u < 0) | (u >= w)
    beneath = np.clip(v, 0, h - 1) * w + np.clip(u, 0, w - 1)
    edge, seen, here = ~own[beneath] | cut, depth.ravel()[beneath], depth.ravel()[low]
    hidden = cut | (edge & (seen > 0) & (seen < here - _IN_FRONT))
    farther = ~cut & edge & (seen > here + _IN_FRONT)
    count = max(1.0, float(np.count_nonzero(edge)))
    return float(np.count_nonzero(hidden)) / count, float(np.count_nonzero(farther)) / count


@kernel("f4(f4[:,::1], f4[:,::1])")
def _square(one: NDArray[np.float32], other: NDArray[np.float32]) -> np.float32:
    """The square of the least distance between two sets of points, (n, 3) and (m, 3)."""
    least = np.float32(np.inf)
    for i in range(len(one)):
        for j in range(len(other)):
            a, b, c = one[i, 0] - other[j, 0], one[i, 1] - other[j, 1], one[i, 2] - other[j, 2]
            square = a * a + b * b + c * c
            least = square if square < least else least
    return least
