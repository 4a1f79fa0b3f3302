"""The map's surface as small cells, and which of them are near: what segmentation works on."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.blocks import SIDE, STEPS, Blocks, enter_pairs, find_around, find_blocks, number_cells
from spot3d.kernel import kernel


@dataclass(frozen=True, slots=True)
class Surface:
    """Cells of equal size that hold the points of a surface.

    edge: of a cell, metres; centre: (n, 3) float32 metres, mean of the cell's points; normal: (n, 3) float32 unit
    (zero if unknown); heat: (n,) float32 mean confidence of the points; size: (n,) float32, their number;
    cell_of_point: (points,) int32, -1 = none.
    """

    edge: float
    centre: NDArray[np.float32]
    normal: NDArray[np.float32]
    heat: NDArray[np.float32]
    size: NDArray[np.float32]
    cell_of_point: NDArray[np.int32]
    blocks: Blocks


def gather_cells(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    heat: NDArray[np.float32],
    edge: float,
    least: float = 0.0,
) -> tuple[Surface, Surface]:
    """Gather points into cells of `edge` metres, and all of them into cells `SIDE` times as large, the blocks of those.

    points: (n, 3) float32 metres; normals: (n, 3) float32, weighted by their length; heat: (n,) float32. Points
    colder than `least` belong to no small cell.
    """
    number, keys = np.empty(len(points), np.int32), np.empty(len(points), np.int64)
    outer_place, place = np.empty(len(points), np.uint8), np.empty(len(points), np.uint8)
    count: int = find_blocks(points, np.float32(1 / edge), number, outer_place, place, keys)
    outer, coarse_of_point = number_cells(find_around(keys[:count]), number, outer_place, heat, -np.inf)
    blocks, cell_of_point = number_cells(outer.cells_around(), coarse_of_point, place, heat, least)
    cells = len(blocks.place)
    sums = np.full((cells + len(outer.place), 8), np.float32(0))
    centre, normal = np.empty((len(sums), 3), np.float32), np.empty((len(sums), 3), np.float32)
    mean, size = np.empty(len(sums), np.float32), np.empty(len(sums), np.float32)
    _gather(points, normals, heat, cell_of_point, coarse_of_point, blocks.first, sums)
    _means(sums, centre, normal, mean, size)
    return (
        Surface(edge, centre[:cells], normal[:cells], mean[:cells], size[:cells], cell_of_point, blocks),
        Surface(SIDE * edge, centre[cells:], normal[cells:], mean[cells:], size[cells:], coarse_of_point, outer),
    )


def near_pairs(surface: Surface, member: NDArray[np.bool_] | None = None) -> NDArray[np.uint32]:
    """(m, 2) uint32: pairs of cells no more than two cell edges apart, each pair once.

    member: (n,) bool, cells that take part; default: all.
    """
    blocks = surface.blocks
    member = np.ones(len(blocks.place), np.bool_) if member is None else member
    pairs = np.empty((len(blocks.place) * STEPS + 1, 2), np.uint32)
    count: int = enter_pairs(blocks.around, blocks.first, blocks.place, member, blocks.cell_at(member), pairs)
    return pairs[:count]


def rows_of_groups(
    member: NDArray[np.int32], size: NDArray[np.floating] | NDArray[np.int64], group: NDArray[np.int32], groups: int
) -> list[NDArray[np.int64]]:
    """The rows of each group, in their order, by way of something smaller that each row is a member of.

    member: (n,) int32, -1 = of none; size: (m,) rows of each of those; group: (m,) int32, 0 to groups - 1, -1 = none.
    """
    sizes = np.bincount(group[group >= 0], size[group >= 0], groups)
    borders = np.concatenate(([0], np.cumsum(sizes))).astype(np.int64)
    rows = np.empty(borders[-1], np.int64)
    _enter_rows(member, group, borders[:-1].copy(), rows)
    return [rows[begin:end] for begin, end in pairwise(borders)]


def points_of_cells(surface: Surface, groups: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """The rows of the points in each group of cells."""
    group = np.full(len(surface.centre), np.int32(-1))
    for number, cells in enumerate(groups):
        group[cells] = number
    return rows_of_groups(surface.cell_of_point, surface.size, group, len(groups))


@kernel("void(f4[:,::1], f4[:,::1], f4[::1], i4[::1], i4[::1], i4[::1], f4[:,::1])")
def _gather(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    heat: NDArray[np.float32],
    cell_of_point: NDArray[np.int32],
    block_of_point: NDArray[np.int32],
    first: NDArray[np.int32],
    sums: NDArray[np.float32],
) -> None:
    """Sums (position, normal, heat, count) of each cell, and after them those of each block. first: its first cell."""
    cells = np.int64(first[-1])
    for i in range(len(points)):
        held_by = np.int64(cell_of_point[i])
        row = np.uint64(held_by if held_by >= 0 else cells + block_of_point[i])
        for axis in range(3):
            sums[row, axis] += points[i, axis]
            sums[row, 3 + axis] += normals[i, axis]
        sums[row, 6] += heat[i]
        sums[row, 7] += np.float32(1)
    for block in range(len(first) - 1):
        for cell in range(first[block], first[block + 1]):
            for column in range(8):
                sums[cells + block, column] += sums[cell, column]


@kernel("void(f4[:,::1], f4[:,::1], f4[:,::1], f4[::1], f4[::1])")
def _means(
    sums: NDArray[np.float32],
    centre: NDArray[np.float32],
    normal: NDArray[np.float32],
    heat: NDArray[np.float32],
    size: NDArray[np.float32],
) -> None:
    """Centres, unit normals, mean heat and number of points from the sums of `_gather`."""
    one = np.float32(1)
    for cell in range(len(sums)):
        x, y, z = sums[cell, 3], sums[cell, 4], sums[cell, 5]
        share, scale = one / sums[cell, 7], one / max(np.sqrt(x * x + y * y + z * z), np.float32(1e-9))
        for axis in range(3):
            centre[cell, axis] = sums[cell, axis] * share
            normal[cell, axis] = sums[cell, 3 + axis] * scale
        heat[cell], size[cell] = sums[cell, 6] * share, sums[cell, 7]


@kernel("Tuple((i8[::1], f8[::1]))(i4[::1], f4[::1])")
def sums_of_groups(
    group: NDArray[np.int32], values: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """How many values each group has, and their sum. group: (n,) int32, from 0, -1 = none."""
    groups = group.max() + 1 if len(group) > 0 else 0
    size, total = np.zeros(groups, np.int64), np.zeros(groups)
    for i in range(len(group)):
        if group[i] >= 0:
            size[group[i]] += 1
            total[group[i]] += values[i]
    return size, total


@kernel("void(i4[::1], i4[::1], i8[::1], i8[::1])")
def _enter_rows(
    member: NDArray[np.int32], group: NDArray[np.int32], filled: NDArray[np.int64], rows: NDArray[np.int64]
) -> None:
    """Enter the rows by their group (see `rows_of_groups`). filled: where each group begins; where it ends, then."""
    for i in range(len(member)):
        number = group[member[i]] if member[i] >= 0 else -1
        if number >= 0:
            rows[filled[number]] = i
            filled[number] += 1


@kernel("f4[:,::1](f4[:,:], i8[:])")
def taken(values: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """These rows of (n, 3) values: what `take` does, which is several times slower for rows as short."""
    found = np.empty((len(rows), 3), np.float32)
    for k in range(len(rows)):
        for axis in range(3):
            found[k, axis] = values[rows[k], axis]
    return found


@kernel("f8(f4[::1], f4[::1], i8[:])")
def mean_of_cells(values: NDArray[np.float32], size: NDArray[np.float32], cells: NDArray[np.int64]) -> float:
    """The mean over the points of some cells. values: (n,) means of cells; size: (n,) their points."""
    total, count = 0.0, 0.0
    for cell in cells:
        total += values[cell] * size[cell]
        count += size[cell]
    return total / count


@kernel("f8[::1](f4[:,:])")
def middle_of(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """The mean of (n, 3) points; the origin without any."""
    middle = np.zeros(3)
    for i in range(len(points)):
        for axis in range(3):
            middle[axis] += points[i, axis]
    return middle / max(1, len(points))
