"""The inside and the outside of a vessel are one object, though no visible surface connects them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.boxes import rotation_to_upright, sampled

_LEVEL = 0.4
"""Normals with less than this of their length level are the bottom's, and say nothing of the axis."""
_WALLS_MIN = 10
"""Fewer points tell no axis."""
_BENT = 0.95
"""The normals of an arc of 60 degrees have a mean of this length; those of a flat patch a longer one."""
_AIMED = 0.9
"""Normals point to the axis within 25 degrees in the mean."""
_WALL = 0.03
"""The outside of a vessel lies no further outside its inside than this: its wall, and the axis' error, metres."""
_WITHIN = 0.8
"""Share of the outside's points within that: a handle may stick out."""
_RIM = 0.02
"""The outside of a vessel reaches up to its rim, less what depth at an edge may miss, metres."""


@dataclass(frozen=True, slots=True)
class Hollow:
    """A surface bent around an upright axis and seen from inside.

    axis: (2,) its place; radius: its largest distance from there; rim: height of its top; all in metres.
    """

    axis: NDArray[np.float64]
    radius: float
    rim: float


def hollow_groups(
    parts: list[NDArray[np.int64]],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    up: NDArray[np.float64],
    size_max: float,
) -> list[list[int]]:
    """Which parts belong together: what is bent around an upright axis, and all around the same axis no further away.

    parts: rows of (n, 3) points in metres and of their unit normals, which point to the camera; size_max: a hollow
    wider than this, metres, is no vessel's. Each part's number is in one group; the largest hollow chooses first.
    """
    R = rotation_to_upright(up).T.astype(np.float32)
    upright = [(sampled(points, part) @ R, sampled(normals, part) @ R) for part in parts]
    hollows = {k: hollow for k, (places, facing) in enumerate(upright) if (hollow := _hollow(places, facing))}
    group_of = {k: [k] for k in range(len(parts))}
    for k in sorted(hollows, key=lambda k: -len(parts[k])):
        if k in group_of and 2 * hollows[k].radius <= size_max:
            around = [j for j in group_of if j != k and _around(upright[j][0], hollows[k])]
            group_of[k] += [number for j in around for number in group_of.pop(j)]
    return list(group_of.values())


def _around(places: NDArray[np.float32], hollow: Hollow) -> bool:
    """Whether (n, 3) upright places lie around a hollow and reach up to its rim."""
    distance = np.linalg.norm(places[:, :2] - hollow.axis, axis=1)
    near = np.mean(distance < hollow.radius + _WALL) >= _WITHIN
    return bool(near and _top(places) > hollow.rim - _RIM)


def _top(places: NDArray[np.float32]) -> float:
    return float(np.quantile(places[:, 2], 0.98))


def _hollow(places: NDArray[np.float32], normals: NDArray[np.float32]) -> Hollow | None:
    """What (n, 3) upright places with these normals are bent around: most normals' level parts meet its axis."""
    length = np.linalg.norm(normals[:, :2], axis=1)
    walls = length > _LEVEL
    if np.count_nonzero(walls) < _WALLS_MIN:
        return None
    p, n = places[walls, :2], normals[walls, :2] / length[walls, None]
    if np.linalg.norm(n.mean(axis=0)) > _BENT:
        return None
    # The point nearest to all lines along the normals.
    across = np.eye(2) - n[:, :, None] * n[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.det(total) < 1e-9 * len(p) ** 2:
        return None
    axis = np.linalg.solve(total, np.einsum("nij,nj->i", across, p))
    inwards = axis - p
    distance = np.linalg.norm(inwards, axis=1)
    aim = float(np.mean(np.einsum("nj,nj->n", n, inwards) / np.maximum(distance, 1e-9)))
    return Hollow(axis, float(np.quantile(distance, 0.95)), _top(places)) if aim >= _AIMED else None
