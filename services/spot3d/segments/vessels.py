"""The inside and the outside of a vessel are one object, though no visible surface connects them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.upright import rotation_to_upright, sampled
from spot3d.kernel import kernel

_LEVEL = 0.4
"""Normals with less than this of their length level are the bottom's, and say nothing of the axis."""
_WALLS_MIN = 10
"""Fewer points tell no axis."""
_BENT = 0.95
"""The normals of an arc of 60 degrees have a mean of this length; those of a flat patch a longer one."""
_AIMED = 0.9
"""Normals point to the axis within 25 degrees in the mean."""
_RING = 0.12
"""The walls of a ring are this share of its radius thick, each way; a square's corners are farther out."""
_SIDE, _SIDES, _ARC = np.pi / 6, 7, 4
"""A ring is seen in so many of the twelve directions that are so wide, radians; of one that faces its axis, an arc."""
_FACING = 0.5
"""... in the mean with this cosine: where places tell the axis, normals tell but the inside from the outside."""
_WALL = 0.03
"""The outside of a vessel lies no further outside its inside than this: its wall, and the axis' error, metres."""
_WITHIN = 0.8
"""Share of the outside's points within that: a handle may stick out."""
_RIM = 0.02
"""The outside of a vessel reaches up to its rim, less what depth at an edge may miss, metres."""


@dataclass(frozen=True, slots=True)
class Hollow:
    """A surface around an upright axis, seen from inside or from both sides.

    axis: (2,) its place; radius: its largest distance from there; rim: height of its top; all in metres.
    """

    axis: NDArray[np.float64]
    radius: float
    rim: float


def hollow_groups(
    parts: list[NDArray[np.int64]],
    samples: list[NDArray[np.float32]],
    normals: NDArray[np.float32],
    up: NDArray[np.float64],
    size_max: float,
) -> list[list[int]]:
    """Which parts belong together: what is bent around an upright axis, and all around the same axis no further away.

    parts: rows of points; samples: (m, 3) places of each part's, metres (see `sampled`); normals: (n, 3) unit normals
    of all points, which point to the camera; size_max: a hollow wider than this, metres, is no vessel's.
    Each part's number is in one group; the largest hollow chooses first.
    """
    R = rotation_to_upright(up).T.astype(np.float32)
    upright = [(places @ R, sampled(normals, part) @ R) for part, places in zip(parts, samples, strict=True)]
    found = {k: _hollow(places, facing) or _ring(places, facing) for k, (places, facing) in enumerate(upright)}
    hollows = {k: hollow for k, hollow in found.items() if hollow is not None}
    group_of = {k: [k] for k in range(len(parts))}
    for k in sorted(hollows, key=lambda k: -len(parts[k])):
        if k in group_of and 2 * hollows[k].radius <= size_max:
            around = [j for j in group_of if j != k and _around(upright[j][0], hollows[k])]
            group_of[k] += [number for j in around for number in group_of.pop(j)]
    return list(group_of.values())


def _around(places: NDArray[np.float32], hollow: Hollow) -> bool:
    """Whether (n, 3) upright places lie around a hollow, reach up to its rim and begin below it."""
    if _share_near(places, hollow.axis, hollow.radius + _WALL) < _WITHIN:
        return False
    bottom, top = np.quantile(places[:, 2], (0.02, 0.98))
    return bool(top > hollow.rim - _RIM and bottom < hollow.rim - _RIM)


@kernel("f8(f4[:,::1], f8[:], f8)")
def _share_near(places: NDArray[np.float32], axis: NDArray[np.float64], radius: float) -> float:
    """Share of (n, 3) upright places nearer to an upright axis than `radius`, metres."""
    near = 0
    for i in range(len(places)):
        near += (places[i, 0] - axis[0]) ** 2 + (places[i, 1] - axis[1]) ** 2 < radius * radius
    return near / len(places)


def _top(places: NDArray[np.float32]) -> float:
    return float(np.quantile(places[:, 2], 0.98))


def _hollow(places: NDArray[np.float32], normals: NDArray[np.float32]) -> Hollow | None:
    """What (n, 3) upright places with these normals are bent around: most normals' level parts meet its axis."""
    x, y, aim = _aimed_at(places, normals)
    if aim < _AIMED:
        return None
    axis = np.array([x, y])
    walls = np.linalg.norm(normals[:, :2], axis=1) > _LEVEL
    distance = np.linalg.norm(places[walls, :2] - axis, axis=1)
    return Hollow(axis, float(np.quantile(distance, 0.95)), _top(places))


def _ring(places: NDArray[np.float32], normals: NDArray[np.float32]) -> Hollow | None:
    """What (n, 3) upright places stand around at one distance: on most sides, as thin walls do seen from both sides, or
    in an arc whose walls, by their normals, face the axis, as a vessel's inside does."""
    x, y, share, sides = _ring_of(places)
    if share < _WITHIN or sides < _ARC:
        return None
    axis = np.array([x, y])
    inwards = axis - places[:, :2]
    distance, level = np.linalg.norm(inwards, axis=1), np.linalg.norm(normals[:, :2], axis=1)
    if sides < _SIDES:
        walls = level > _LEVEL
        aim = (inwards * normals[:, :2]).sum(axis=1)[walls] / np.maximum(distance * level, 1e-9)[walls]
        if len(aim) < _WALLS_MIN or aim.mean() < _FACING:
            return None
    return Hollow(axis, float(np.quantile(distance, 0.95)), _top(places))


@kernel("Tuple((f8, f8, f8, i8))(f4[:,::1])")
def _ring_of(places: NDArray[np.float32]) -> tuple[float, float, float, int]:
    """The circle through (n, 3) places, seen from above, by least squares (Kasa, 1976).

    Returns its middle's x and y, the share of the places that are on it, and on how many of its twelve sides they are.
    The share is 0 where the places stand in a line, or at one point.
    """
    n, middle_x, middle_y = len(places), 0.0, 0.0
    for i in range(n):
        middle_x, middle_y = middle_x + places[i, 0] / n, middle_y + places[i, 1] / n
    xx, xy, yy, right_x, right_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        x, y = places[i, 0] - middle_x, places[i, 1] - middle_y
        square = x * x + y * y
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        right_x, right_y = right_x + square * x / 2, right_y + square * y / 2
    determinant = xx * yy - xy * xy
    if not determinant > 1e-9 * (xx + yy) ** 2:
        return middle_x, middle_y, 0.0, 0
    a, b = (yy * right_x - xy * right_y) / determinant, (xx * right_y - xy * right_x) / determinant
    radius = np.sqrt((xx + yy) / n + a * a + b * b)
    on, seen = 0, np.zeros(12, np.bool_)
    for i in range(n):
        x, y = places[i, 0] - middle_x - a, places[i, 1] - middle_y - b
        if abs(np.sqrt(x * x + y * y) - radius) < _RING * radius:
            on += 1
            seen[int((np.arctan2(y, x) + np.pi) / _SIDE) % 12] = True
    return middle_x + a, middle_y + b, on / n, seen.sum()


@kernel("Tuple((f8, f8, f8))(f4[:,::1], f4[:,::1])")
def _aimed_at(places: NDArray[np.float32], normals: NDArray[np.float32]) -> tuple[float, float, float]:
    """The place that is nearest to all lines along the walls' normals, and the mean cosine of these towards it.

    The cosine is -1 where the walls are too few or too flat to tell a place.
    """
    level = np.empty((len(places), 4))
    count, nx, ny, xx, xy, yy, right_x, right_y = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(places)):
        u, v = np.float64(normals[i, 0]), np.float64(normals[i, 1])
        length = np.sqrt(u * u + v * v)
        if length > _LEVEL:
            x, y, u, v = np.float64(places[i, 0]), np.float64(places[i, 1]), u / length, v / length
            level[count, 0], level[count, 1], level[count, 2], level[count, 3] = x, y, u, v
            count += 1
            nx, ny, xx, xy, yy = nx + u, ny + v, xx + v * v, xy - u * v, yy + u * u
            right_x += v * v * x - u * v * y
            right_y += u * u * y - u * v * x
    flat = nx * nx + ny * ny > (_BENT * count) ** 2
    determinant = xx * yy - xy * xy
    if count < _WALLS_MIN or flat or determinant < 1e-9 * count**2:
        return 0.0, 0.0, -1.0
    axis_x, axis_y = (yy * right_x - xy * right_y) / determinant, (xx * right_y - xy * right_x) / determinant
    aim = 0.0
    for i in range(count):
        inwards_x, inwards_y = axis_x - level[i, 0], axis_y - level[i, 1]
        distance = max(np.sqrt(inwards_x**2 + inwards_y**2), 1e-9)
        aim += (level[i, 2] * inwards_x + level[i, 3] * inwards_y) / distance
    return axis_x, axis_y, aim / count
