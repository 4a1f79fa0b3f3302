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
    first, places, coarse_of_point = number_cells(count, number, outer_place, heat, -np.inf)
    outer = Blocks(find_around(keys[:count]), first, places)
    first, places, cell_of_point = number_cells(len(places), coarse_of_point, place, heat, least)
    blocks = Blocks(outer.cells_around(np.diff(first) > 0), first, places)
    cells = len(blocks.place)
    sums = np.full((cells + len(outer.place), 8), np.float32(0))
    centre, normal, mean, size = _columns(len(sums))
    _gather(points, normals, heat, cell_of_point, coarse_of_point, blocks.first, sums)
    _means(sums, centre, normal, mean, size)
    return (
        Surface(edge, centre[:cells], normal[:cells], mean[:cells], size[:cells], cell_of_point, blocks),
        Surface(SIDE * edge, centre[cells:], normal[cells:], mean[cells:], size[cells:], coarse_of_point, outer),
    )


def only(surface: Surface, kept: NDArray[np.bool_]) -> Surface:
    """The surface of these cells alone, (n,) bool, in the same blocks."""
    old, blocks, cells = surface, surface.blocks, int(np.count_nonzero(kept))
    centre, normal, heat, size = _columns(cells)
    first, place, number = np.empty_like(blocks.first), np.empty(cells, np.uint8), np.empty(len(kept) + 1, np.int32)
    columns = (centre, normal, heat, size, place)
    _keep(kept, blocks.first, old.centre, old.normal, old.heat, old.size, blocks.place, *columns, first, number)
    cell_of_point = np.empty_like(old.cell_of_point)
    _renumber(old.cell_of_point, number, cell_of_point)
    return Surface(old.edge, centre, normal, heat, size, cell_of_point, Blocks(blocks.around, first, place))


def _columns(
    cells: int,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Room for the centre, normal, heat and size of so many cells."""
    centre, normal = np.empty((cells, 3), np.float32), np.empty((cells, 3), np.float32)
    return centre, normal, np.empty(cells, np.float32), np.empty(cells, np.float32)


def near_pairs(surface: Surface) -> NDArray[np.uint32]:
    """(m, 2) uint32: pairs of cells no more than two cell edges apart, each pair once."""
    blocks = surface.blocks
    pairs = np.empty((len(blocks.place) * STEPS + 1, 2), np.uint32)
    count: int = enter_pairs(blocks.around, blocks.first, blocks.place, blocks.cell_at(), pairs)
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


@kernel(
    "void(b1[::1], i4[::1], f4[:,::1], f4[:,::1], f4[::1], f4[::1], u1[::1], "
    "f4[:,::1], f4[:,::1], f4[::1], f4[::1], u1[::1], i4[::1], i4[::1])"
)
def _keep(
    kept: NDArray[np.bool_],
    first: NDArray[np.int32],
    centre: NDArray[np.float32],
    normal: NDArray[np.float32],
    heat: NDArray[np.float32],
    size: NDArray[np.float32],
    place: NDArray[np.uint8],
    new_centre: NDArray[np.float32],
    new_normal: NDArray[np.float32],
    new_heat: NDArray[np.float32],
    new_size: NDArray[np.float32],
    new_place: NDArray[np.uint8],
    new_first: NDArray[np.int32],
    number: NDArray[np.int32],
) -> None:
    """Copy the cells that are kept; enter each block's first one and the new number of each, -1 = not kept."""
    count = np.uint32(0)
    for block in range(len(first) - 1):
        new_first[block] = count
        for cell in range(first[block], first[block + 1]):
            number[cell] = -1
            if kept[cell]:
                for axis in range(3):
                    new_centre[count, axis], new_normal[count, axis] = centre[cell, axis], normal[cell, axis]
                new_heat[count], new_size[count], new_place[count] = heat[cell], size[cell], place[cell]
                number[cell] = count
                count += np.uint32(1)
    new_first[-1], number[-1] = count, -1


@kernel("void(i4[::1], i4[::1], i4[::1])")
def _renumber(cell_of_point: NDArray[np.int32], number: NDArray[np.int32], renumbered: NDArray[np.int32]) -> None:
    """The new number of each point's cell. number: of each cell, and after them of none, -1."""
    none = np.uint32(len(number) - 1)
    for i in range(len(cell_of_point)):
        # No branch, which would often be guessed wrong: no cell, -1, is the largest without a sign.
        renumbered[i] = number[min(np.uint32(cell_of_point[i]), none)]


@kernel("Tuple((i8[::1], f8[::1]))(i4[::1], f4[::1])")
def sums_of_groups(
    group: NDArray[np.int32], values: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """How many values each group has, and their sum. group: (n,) int32, from 0, -1 = none."""
    groups = 0
    for number in group:
        groups = max(groups, number + 1)
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


@kernel("f8[::1](f4[:,::1])")
def middle_of(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """The mean of (n, 3) points; the origin without any."""
    middle = np.zeros(3)
    for i in range(len(points)):
        for axis in range(3):
            middle[axis] += points[i, axis]
    return middle / max(1, len(points))
