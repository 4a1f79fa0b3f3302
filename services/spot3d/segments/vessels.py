"""The inside and the outside of a vessel are one object, though no visible surface connects them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import DepthNoise
from spot3d.geometry.quantiles import quantiles
from spot3d.geometry.upright import taken
from spot3d.kernel import kernel
from spot3d.segments.labels import pixels_of
from spot3d.trajectory import rotation_to_z

_WALL_PIXELS = 20
"""A region of fewer pixels is not tried as a vessel's wall. With 10, 20 and 40 as many vessels are whole in a view."""
_SAMPLE = 500
"""About this many of a region's pixels decide whether it is bent around an axis."""
# On OSD, HOTS, 30 cluttered frames and 24 of a room success and detection of single frames are the same, within 0.008,
# with `_LEVEL`, `_WALLS_MIN` and `_RIM` halved and doubled, `_WITHIN` half and twice as far from 1, `_FACING` and
# `_WALL` halved. With `_WALL` doubled clutter's are 0.87, 0.86 instead of 0.87, 0.88.
_LEVEL = 0.4
"""Normals whose level component is shorter than this belong to the bottom and are not compared with the axis."""
_WALLS_MIN = 10
"""Fewer points of walls do not tell whether these face the axis."""
_RING, _NOISES = 0.12, 2.0
"""Points of a ring deviate from its radius by at most this share of it, or this many deviations of depth noise; a
square's corners are farther out. Mugs and bowls on a rendered table 1.5 to 2 m away that are whole in a view: 0.67 and
0.77 without the noise, 0.74 and 0.87 with it."""
_THICK = 1 / 3
"""A ring whose walls are thicker by noise than this share of its radius is not told from a flat surface. Of faces 4 to
15 cm wide, 1.2 to 2.4 m away, up to one in five is taken for a ring, without this limit up to nine in ten."""
_SIDE, _SIDES, _ARC = np.pi / 6, 7, 4
"""Width of the twelve sectors around an axis, radians; in how many a ring is seen, and an arc that faces its axis."""
_FACING = 0.5
"""Least mean cosine of an arc's normals to the axis: places determine it, normals only tell inside from outside."""
_WALL = 0.03
"""The outside of a vessel is at most this far from its inside, metres: its wall's thickness and the axis' error."""
_WITHIN = 0.8
"""Share of the outside's points that must be within that: a handle may stick out."""
_RIM = 0.02
"""The outside of a vessel reaches up to its rim, less what depth at an edge may miss, metres."""


@dataclass(frozen=True, slots=True)
class Hollow:
    """A surface around an upright axis, seen from inside or from both sides.

    axis: (2,) its level position; radius: its largest distance from the axis; rim: height of its top; all in metres.
    """

    axis: NDArray[np.float64]
    radius: float
    rim: float


def join_vessels(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    up: NDArray[np.float64],
    size_max: float,
    noise: DepthNoise,
) -> NDArray[np.int32]:
    """The labels after joining a region bent around an upright axis with all regions around that axis no farther out.

    labels: (h, w) int32 from 0, -1 = no object; points, normals: (h, w, 3) float32, camera frame, metres and unit;
    up: (3,) unit; size_max: a hollow wider than this, metres, is no vessel. The largest hollow chooses first.
    """
    R = rotation_to_z(up).T.astype(np.float32)
    parts = [pixels for pixels in pixels_of(labels) if len(pixels) >= _WALL_PIXELS]
    upright, hollows = list[NDArray[np.float32]](), {}
    for number, pixels in enumerate(parts):
        rows = pixels[:: max(1, len(pixels) // _SAMPLE)]
        sample = taken(points.reshape(-1, 3), rows)
        upright.append(sample @ R)
        sigma = float(noise.sigma(float(quantiles(sample[:, 2], 0.5)[0])))
        hollow = _hollow(upright[number], taken(normals.reshape(-1, 3), rows) @ R, _NOISES * sigma)
        if hollow is not None:
            hollows[number] = hollow
    group_of = {k: [k] for k in range(len(parts))}
    for k in sorted(hollows, key=lambda k: -len(upright[k])):
        if k in group_of and 2 * hollows[k].radius <= size_max:
            around = [j for j in group_of if j != k and _around(upright[j], hollows[k])]
            group_of[k] += [number for j in around for number in group_of.pop(j)]
    joined = labels.copy()
    for k, group in group_of.items():
        joined.ravel()[np.concatenate([parts[number] for number in group])] = labels.ravel()[parts[k][0]]
    return joined


def _around(places: NDArray[np.float32], hollow: Hollow) -> bool:
    """Whether (n, 3) upright places lie around a hollow, reach up to its rim and begin below it."""
    if _share_near(places, hollow.axis, hollow.radius + _WALL) < _WITHIN:
        return False
    bottom, top = quantiles(places[:, 2], 0.02, 0.98)
    return bool(top > hollow.rim - _RIM and bottom < hollow.rim - _RIM)


@kernel("f8(f4[:,::1], f8[:], f8)")
def _share_near(places: NDArray[np.float32], axis: NDArray[np.float64], radius: float) -> float:
    """Share of (n, 3) upright places nearer to an upright axis than `radius`, metres."""
    near = 0
    for i in range(len(places)):
        near += (places[i, 0] - axis[0]) ** 2 + (places[i, 1] - axis[1]) ** 2 < radius * radius
    return near / len(places)


def _hollow(places: NDArray[np.float32], normals: NDArray[np.float32], scatter: float) -> Hollow | None:
    """The hollow that (n, 3) upright places surround: on most sides, as thin walls seen from both sides do, or in an
    arc whose (n, 3) normals face the axis, as a vessel's inside does. scatter: of the places by noise, metres."""
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
    return Hollow(axis, float(quantiles(distance, 0.95)[0]), float(quantiles(places[:, 2], 0.98)[0]))


def _ring_of(places: NDArray[np.float32], scatter: float) -> tuple[float, float, float, int]:
    """The upright axis that (n, 3) places surround: the square of their distance from it grows with their height.

    By least squares (Kasa, 1976, with a term for the height): exact for a cylinder, and near for a bowl or a cone.
    Returns the axis' x and y, the share of the places that are as far away as they should be, and on how many of its
    twelve sides these are. The share is 0 where the places lie in a plane, or scatter too much for their distance.
    """
    coordinates = np.array(places.T, np.float64, order="C")  # apart they are faster
    middle = coordinates.mean(axis=1)
    x, y, height = coordinates - middle[:, None]
    terms = np.stack((2 * x, 2 * y, height, np.ones(len(x))))
    gram = terms @ terms.T
    spread = np.linalg.eigvalsh(gram[:3, :3])
    if not spread[0] > 1e-9 * spread[2]:
        return float(middle[0]), float(middle[1]), 0.0, 0
    a, b, slope, square = np.linalg.solve(gram, terms @ (x * x + y * y)).tolist()
    square += a * a + b * b
    radius = float(np.sqrt(max(square, 0.0)))
    axis = a + float(middle[0]), b + float(middle[1])
    if scatter > _THICK * radius:
        return *axis, 0.0, 0
    off = np.abs(np.hypot(x - a, y - b) - np.sqrt(np.maximum(square + slope * height, 0)))
    on = off < max(_RING * radius, scatter)
    sides = np.bincount(((np.arctan2(y[on] - b, x[on] - a) + np.pi) / _SIDE).astype(np.int64) % 12)
    return *axis, float(on.mean()), int(np.count_nonzero(sides))
