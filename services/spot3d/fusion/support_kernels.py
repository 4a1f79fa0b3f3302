"""Kernels of `support`: how noisy a sheet is, and what of it is in, beside or near a thing."""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.order import value_at
from spot3d.fusion.sheet_kernels import FACING, height_above
from spot3d.kernel import kernel


@kernel("f8(f4[:,::1], f4[:,::1], i4[::1], b1[:], i8, f8[::1], f8[:,::1], f8[::1], f8[::1])")
def spread_about(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    cell_of_point: NDArray[np.int32],
    on: NDArray[np.bool_],
    step: int,
    plane: NDArray[np.float64],
    axes: NDArray[np.float64],
    middle: NDArray[np.float64],
    warp: NDArray[np.float64],
) -> float:
    """Median distance from their median of the points on a sheet that face its way; of every `step`th point.

    points, normals: (n, 3); on: cells that lie on the sheet. 0 where there are no such points.
    """
    distance, count = np.empty(len(points) // step + 1), 0
    for i in range(0, len(points), step):
        facing = plane[0] * normals[i, 0] + plane[1] * normals[i, 1] + plane[2] * normals[i, 2]
        if on[cell_of_point[i]] and facing > FACING:
            distance[count] = height_above(points[i], plane, axes, middle, warp)
            count += 1
    off = distance[:count]
    median = value_at(off, (count - 1) / 2)
    for i in range(count):
        off[i] = abs(off[i] - median)
    return float(value_at(off, (count - 1) / 2))


@kernel("UniTuple(i8, 2)(f4[:,::1], f8[:], f8[:,:], f8[:], f8)")
def on_long_sides(
    points: NDArray[np.float32],
    centre: NDArray[np.float64],
    rotation: NDArray[np.float64],
    size: NDArray[np.float64],
    margin: float,
) -> tuple[int, int]:
    """How many of (n, 3) points are over or under a box, or within a margin of it, on each of its long sides."""
    low, high = 0, 0
    for i in range(len(points)):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        u = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
        v = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
        if abs(u) < size[0] / 2 + margin and abs(v) < size[1] / 2 + margin:
            across = u if size[0] <= size[1] else v
            high += across > 0
            low += not across > 0
    return low, high


@kernel("i8(f4[:,::1], i8[::1], i4[::1], f8[:], f8[:,:], f8[:])")
def count_foreign(
    points: NDArray[np.float32],
    cells: NDArray[np.int64],
    own: NDArray[np.int32],
    centre: NDArray[np.float64],
    rotation: NDArray[np.float64],
    size: NDArray[np.float64],
) -> int:
    """How many of (n, 3) points, of these cells, lie in a box and are of no cell of its own."""
    highest = 0
    for cell in own:
        highest = max(highest, int(cell))
    is_own = np.zeros(highest + 1, np.bool_)
    for cell in own:
        is_own[cell] = True
    count = 0
    for i in range(len(points)):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        inside = cells[i] > highest or not is_own[cells[i]]
        for axis in range(3):
            along = rotation[0, axis] * x + rotation[1, axis] * y + rotation[2, axis] * z
            inside &= abs(along) < size[axis] / 2
        count += inside
    return count


@kernel("i8(f4[:,::1], f4[:,::1], f8)")
def count_touching(points: NDArray[np.float32], others: NDArray[np.float32], reach: float) -> int:
    """How many of (n, 3) points are nearer than `reach` to one of the others, (m, 3)."""
    count = 0
    for i in range(len(points)):
        for j in range(len(others)):
            x, y, z = points[i, 0] - others[j, 0], points[i, 1] - others[j, 1], points[i, 2] - others[j, 2]
            if x * x + y * y + z * z < reach * reach:
                count += 1
                break
    return count
