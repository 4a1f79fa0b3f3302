"""The part of one box that lies inside another: its faces clipped, and their flux summed."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

_FACES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
"""A box's faces by its corners (see `clipped_volumes`), counter-clockwise as seen from outside."""
_CORNERS_MOST = 48
"""Of a rectangle clipped by six planes: where it lies in one, rounding may keep up to half as many more."""


@kernel("i8(f8[:,:], i8, i8, f8, f8, f8[:,:])")
def _clip(
    polygon: NDArray[np.float64], count: int, axis: int, sign: float, limit: float, kept: NDArray[np.float64]
) -> int:
    """Clip a convex polygon of `count` corners to sign * coordinate <= limit (Sutherland-Hodgman).

    Writes the corners of the remaining part to `kept`, and returns their number.
    """
    size = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = limit - sign * polygon[i, axis], limit - sign * polygon[j, axis]
        if here >= 0:
            for k in range(3):
                kept[size, k] = polygon[i, k]
            size += 1
        if (here >= 0) != (there >= 0):
            share = here / (here - there)
            for k in range(3):
                kept[size, k] = polygon[i, k] + share * (polygon[j, k] - polygon[i, k])
            size += 1
    return size


@kernel("f8(f8[:,:], i8, f8)")
def _flux_above(polygon: NDArray[np.float64], count: int, level: float) -> float:
    """Flux of the field (0, 0, z - level) through a convex polygon, as a fan of triangles."""
    flux = 0.0
    for i in range(1, count - 1):
        px, py = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        qx, qy = polygon[i + 1, 0] - polygon[0, 0], polygon[i + 1, 1] - polygon[0, 1]
        mean_z = (polygon[0, 2] + polygon[i, 2] + polygon[i + 1, 2]) / 3
        flux += (px * qy - py * qx) / 2 * (mean_z - level)
    return flux


@kernel("f8[::1](f8[:,:,:], f8[:,:])")
def clipped_volumes(corners: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Volume of the parts of P boxes, corners (P, 8, 3), inside [-half, half], half (P, 3); returns (P,) m^3.

    Divergence theorem with the field (0, 0, z clamped to the slab): its flux out of the box's part within the
    column |x|, |y| <= half is the volume sought. The column's walls are parallel to the field and the flux is
    continuous where faces coincide, so no wall needs to be built and coplanar faces are no special case.
    Corners: x before y before z, each first low and then high.
    """
    volumes = np.zeros(len(corners))
    one, other = np.empty((_CORNERS_MOST, 3)), np.empty((_CORNERS_MOST, 3))
    for box in range(len(corners)):
        for face in range(6):
            for k in range(4):
                for axis in range(3):
                    one[k, axis] = corners[box, _FACES[face, k], axis]
            count = 4
            for axis in range(2):
                count = _clip(one, count, axis, 1.0, half[box, axis], other)
                count = _clip(other, count, axis, -1.0, half[box, axis], one)
            top = half[box, 2]
            count = _clip(one, count, 2, -1.0, top, other)
            volumes[box] += _flux_above(other, count, -top)
            count = _clip(other, count, 2, -1.0, -top, one)
            volumes[box] -= _flux_above(one, count, top)
    return volumes
