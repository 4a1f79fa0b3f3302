"""The inside and the outside of a vessel are one object, though no visible surface connects them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.geometry.upright import rotation_to_upright, taken
from spot3d.kernel import kernel

# On OSD, HOTS, 30 cluttered frames and 24 of a room success and detection of single frames are the same, within 0.008,
# with `_LEVEL`, `_WALLS_MIN` and `_RIM` half and twice as large, `_WITHIN` half and twice as far from 1, `_FACING` and
# `_WALL` half as large. With `_WALL` twice as large clutter's are 0.87, 0.86 for 0.87, 0.88.
_LEVEL = 0.4
"""Normals with less than this of their length level are the bottom's, and say nothing of the axis."""
_WALLS_MIN = 10
"""Fewer points tell no axis."""
_RING, _NOISES = 0.12, 2.0
"""The walls of a ring are this share of its radius thick, each way, or as much as so many deviations of depth's noise;
a square's corners are farther out. Without the noise 0.67 of the mugs and 0.77 of the bowls on a rendered table 1.5 to
2 m away are whole in a view, with it 0.74 and 0.87."""
_THICK = 1 / 3
"""A ring whose walls noise makes thicker than this share of its radius is not told from a flat thing: of faces 4 to 15
cm wide, 1.2 to 2.4 m away, up to one in five is taken for one, up to nine in ten where there is no limit."""
_SIDE, _SIDES, _ARC = np.pi / 6, 7, 4
"""A ring is seen in so many of the twelve directions that are so wide, radians; of one that faces its axis, an arc."""
_FACING = 0.5
"""... in the mean with this cosine: places tell the axis, normals but the inside from the outside."""
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
    noise: DepthNoise = KINECT_V1,
) -> list[list[int]]:
    """Which parts belong together: what is bent around an upright axis, and all around the same axis no further away.

    parts: rows of points; samples: (m, 3) places of each part's, camera frame, metres; normals: (n, 3)
    unit normals of all points, which point to the camera; size_max: a hollow wider than this, metres, is no vessel's.
    Each part's number is in one group; the largest hollow chooses first.
    """
    R = rotation_to_upright(up).T.astype(np.float32)
    upright = [places @ R for places in samples]
    hollows = {}
    for number, (part, sample, places) in enumerate(zip(parts, samples, upright, strict=True)):
        sigma = float(noise.sigma(float(np.median(sample[:, 2]))))
        hollow = _hollow(places, taken(normals, part) @ R, _NOISES * sigma)
        if hollow is not None:
            hollows[number] = hollow
    group_of = {k: [k] for k in range(len(parts))}
    for k in sorted(hollows, key=lambda k: -len(parts[k])):
        if k in group_of and 2 * hollows[k].radius <= size_max:
            around = [j for j in group_of if j != k and _around(upright[j], hollows[k])]
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


def _hollow(places: NDArray[np.float32], normals: NDArray[np.float32], scatter: float) -> Hollow | None:
    """What (n, 3) upright places stand around: on most sides, as thin walls do seen from both sides, or in an arc
    whose walls, by their (n, 3) normals, face the axis, as a vessel's inside does. scatter: by noise, metres."""
    x, y, share, sides = _ring_of(places, scatter)
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
    return Hollow(axis, float(np.quantile(distance, 0.95)), float(np.quantile(places[:, 2], 0.98)))


def _ring_of(places: NDArray[np.float32], scatter: float) -> tuple[float, float, float, int]:
    """The upright axis that (n, 3) places surround: the square of their distance from it grows with their height.

    By least squares (Kasa, 1976, with a term for the height): exact for a cylinder, and near for a bowl or a cone.
    Returns the axis' x and y, the share of the places that are as far away as they should be, and on how many of its
    twelve sides these are. The share is 0 where the places lie in a plane, or scatter too much for their distance.
    """
    middle = places.mean(axis=0, dtype=np.float64)
    level, height = places[:, :2] - middle[:2], places[:, 2] - middle[2]
    terms = np.column_stack((2 * level, height, np.ones(len(places))))
    gram = terms.T @ terms
    spread = np.linalg.eigvalsh(gram[:3, :3])
    if not spread[0] > 1e-9 * spread[2]:
        return float(middle[0]), float(middle[1]), 0.0, 0
    a, b, slope, square = np.linalg.solve(gram, terms.T @ (level**2).sum(axis=1)).tolist()
    square += a * a + b * b
    radius = float(np.sqrt(max(square, 0.0)))
    away = level - (a, b)
    off = np.abs(np.hypot(*away.T) - np.sqrt(np.maximum(square + slope * height, 0)))
    on = off < max(_RING * radius, scatter)
    if scatter > _THICK * radius:
        on[:] = False
    sides = np.unique(((np.arctan2(away[on, 1], away[on, 0]) + np.pi) / _SIDE).astype(np.int64) % 12)
    return a + float(middle[0]), b + float(middle[1]), float(on.mean()), len(sides)
