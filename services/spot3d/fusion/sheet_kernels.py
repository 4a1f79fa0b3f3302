"""Kernels of `sheet`: distances from a sheet, and which cells lie on it."""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.components import root_of
from spot3d.kernel import kernel, part

FACING = 0.7
"""Cosine (45 degrees) within which a cell faces as the sheet it lies on."""
_FLAT_HEIGHT = 0.03
"""A thin flat thing (a book, a plate) is at most this high, metres."""
_FLAT_FACING = 0.9
"""Cosine (26 degrees) within which the top of a flat thing faces as its support."""
_EXTENT = 1.1
"""Half extents of a sheet's rectangle within which things lie on it: what overhangs its edge a little does too."""
BOARD = 0.04
"""A table's or a shelf's board is at most this thick, metres."""


@part()
def height_above(
    point: NDArray[np.floating],
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
) -> float:
    """Signed distance of a point from a sheet."""
    height, x, y = plane[3], 0.0, 0.0
    for axis in range(3):
        height += plane[axis] * point[axis]
        x += axes[0, axis] * (point[axis] - middle[axis])
        y += axes[1, axis] * (point[axis] - middle[axis])
    x, y = min(max(x, -1.0), 1.0), min(max(y, -1.0), 1.0)
    return float(height - (warp[0] + warp[1] * x + warp[2] * y + warp[3] * x * x + warp[4] * x * y + warp[5] * y * y))


@kernel("f8(f8[:], f8[::1], f8[:,::1], f8[::1], f8[::1])")
def distance_of(
    point: NDArray[np.float64],
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
) -> float:
    """Signed distance of one (3,) point from a sheet (see `Sheet.distance`)."""
    return height_above(point, plane, axes, middle, warp)


@kernel("f8[::1](f4[:,::1], f8[::1], f8[:,::1], f8[::1], f8[::1])")
def distances(
    points: NDArray[np.float32],
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Signed distances of (n, 3) points from a sheet (see `Sheet.distance`)."""
    heights = np.empty(len(points))
    for i in range(len(points)):
        heights[i] = height_above(points[i], plane, axes, middle, warp)
    return heights


@kernel("f8[::1](f4[:,::1], f8[::1])")
def plane_distances(points: NDArray[np.float32], plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed distances of (n, 3) points from a plane. Without a branch: several points are computed at once."""
    found = np.empty(len(points))
    a, b, c, d = plane[0], plane[1], plane[2], plane[3]
    for i in range(len(points)):
        found[i] = d + a * points[i, 0] + b * points[i, 1] + c * points[i, 2]
    return found


@kernel("Tuple((b1[::1], b1[::1]))(f4[:,::1], f4[:,::1], f8, f8[::1], f8[:,::1], f8[::1], f8[::1])")
def cells_at_sheet(
    centre: NDArray[np.float32],
    normal: NDArray[np.float32],
    reach: float,
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which cells lie within `reach` of a sheet, and which of those face its way: (n,) bool each."""
    near, facing = np.zeros(len(centre), np.bool_), np.zeros(len(centre), np.bool_)
    far = reach + np.abs(warp).sum()  # nothing is farther from a sheet than from its plane by more than its warp
    height = plane_distances(centre, plane)
    for i in range(len(centre)):
        if abs(height[i]) < far and abs(height_above(centre[i], plane, axes, middle, warp)) < reach:
            near[i] = True
            facing[i] = plane[0] * normal[i, 0] + plane[1] * normal[i, 1] + plane[2] * normal[i, 2] > FACING
    return near, facing


@kernel("void(b1[::1], f4[:,::1], f4[:,::1], i4[::1], b1[:], b1[:], f8, f8[::1], f8[:,::1], f8[::1], f8[::1])")
def mark_sheet(
    structure: NDArray[np.bool_],
    centre: NDArray[np.float32],
    normal: NDArray[np.float32],
    first: NDArray[np.int32],
    on: NDArray[np.bool_],
    near: NDArray[np.bool_],
    thickness: float,
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
) -> None:
    """Mark the cells that lie on a sheet or on its board's edge (see `on_sheets`).

    first: the first cell of each coarse cell; on, near: coarse cells.
    """
    for coarse in range(len(on)):
        if not (on[coarse] or near[coarse]):
            continue
        for i in range(first[coarse], first[coarse + 1]):
            height = height_above(centre[i], plane, axes, middle, warp)
            facing = plane[0] * normal[i, 0] + plane[1] * normal[i, 1] + plane[2] * normal[i, 2]
            flush = abs(height) < thickness and (facing > FACING or abs(height) < thickness / 2)
            structure[i] |= (on[coarse] and flush) or (near[coarse] and -BOARD < height < 0)


@part()
def _above(point: NDArray[np.float32], extent: NDArray[np.float64], middle: NDArray[np.float64]) -> bool:
    """Whether a point is over (or under) a rectangle; extent: its axes over its half extents (2, 3)."""
    inside = True
    for k in range(2):
        along = 0.0
        for axis in range(3):
            along += extent[k, axis] * (point[axis] - middle[axis])
        inside &= abs(along) <= _EXTENT
    return inside


@kernel(
    "void(b1[:], f4[:,::1], f4[:,::1], i4[::1], f4[:,::1], f8, f8[::1], f8[:,::1], f8[::1], f8[::1], f8[:,:], f8[:])"
)
def mark_flat(
    flat: NDArray[np.bool_],
    centre: NDArray[np.float32],
    normal: NDArray[np.float32],
    first: NDArray[np.int32],
    coarse_centre: NDArray[np.float32],
    reach: float,
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
    extent: NDArray[np.float64],
    centre_of_extent: NDArray[np.float64],
) -> None:
    """Mark the cells that lie flat on a level sheet (see `lying_flat`), over the rectangle in which it was seen.

    first: the first cell of each coarse cell; reach: none of its cells' centres is further from its own, metres.
    """
    for coarse in range(len(coarse_centre)):
        above = height_above(coarse_centre[coarse], plane, axes, middle, warp)
        if not -2 * reach < above < _FLAT_HEIGHT + 2 * reach:  # a warp changes less than the place from cell to cell
            continue
        for i in range(first[coarse], first[coarse + 1]):
            if plane[0] * normal[i, 0] + plane[1] * normal[i, 1] + plane[2] * normal[i, 2] > _FLAT_FACING:
                height = height_above(centre[i], plane, axes, middle, warp)
                flat[i] |= height > 0 and height < _FLAT_HEIGHT and _above(centre[i], extent, centre_of_extent)


@kernel("u1[:,::1](u4[:,::1], u1[:,::1])")
def with_neighbours(pairs: NDArray[np.uint32], member: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The members of sets of cells and the cells near them, (sets / 8, n) uint8, a bit a set. pairs: near cells."""
    near = member.copy()
    for eight in range(len(member)):
        for k in range(len(pairs)):
            i, j = pairs[k, 0], pairs[k, 1]
            of_i, of_j = member[eight, i], member[eight, j]
            if of_i != of_j:  # rare
                near[eight, i] |= of_j
                near[eight, j] |= of_i
    return near


@kernel("b1[::1](f4[:,::1], u4[:,::1], i8[::1], b1[::1], f8)")
def in_long_groups(
    centre: NDArray[np.float32],
    pairs: NDArray[np.uint32],
    begin: NDArray[np.int64],
    member: NDArray[np.bool_],
    reach: float,
) -> NDArray[np.bool_]:
    """Which members are connected over more than `reach` metres, from corner to corner: (n,) bool.

    pairs: near cells, in the order of the first of both; begin: where each cell's pairs begin and the last one's end.
    Union-find with path halving, over the members' pairs alone: they are few.
    """
    root, long = np.empty(len(member), np.uint32), np.zeros(len(member), np.bool_)
    low, high = np.empty_like(centre), np.empty_like(centre)
    for cell in range(len(member)):
        if member[cell]:
            root[cell] = cell
            for axis in range(3):
                low[cell, axis] = high[cell, axis] = centre[cell, axis]
    for cell in range(len(member)):
        for k in range(begin[cell], begin[cell + 1] if member[cell] else 0):
            if not member[pairs[k, 1]]:
                continue
            i, j = root_of(root, np.uint32(cell)), root_of(root, pairs[k, 1])
            i, j = min(i, j), max(i, j)
            root[j] = i
            for axis in range(3):
                low[i, axis], high[i, axis] = min(low[i, axis], low[j, axis]), max(high[i, axis], high[j, axis])
    for cell in range(len(member)):
        if member[cell]:
            root[cell] = root[root[cell]]
            square = 0.0
            for axis in range(3):
                square += (high[root[cell], axis] - low[root[cell], axis]) ** 2
            long[cell] = square > reach * reach
    return long
