"""The map's surface as small cells, and which of them are near: what segmentation works on."""

from dataclasses import dataclass
from itertools import pairwise

import numba as nb
import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.blocks import NONE, PLACES, STEPS, Blocks, enter_pairs, find_blocks, number_cells


@dataclass(frozen=True, slots=True)
class Surface:
    """Cells of equal size that hold the points of a surface.

    edge: of a cell, metres; centre: (n, 3) float32 metres, mean of the cell's points; normal: (n, 3) float32 unit
    (zero if unknown); heat: (n,) float32 mean confidence of the points; cell_of_point: (points,) int32, -1 = none.
    """

    edge: float
    centre: NDArray[np.float32]
    normal: NDArray[np.float32]
    heat: NDArray[np.float32]
    cell_of_point: NDArray[np.int32]
    blocks: Blocks


def gather_cells(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    heat: NDArray[np.float32],
    edge: float,
    least: float = 0.0,
) -> Surface:
    """Gather points into cells of `edge` metres.

    points: (n, 3) float32 metres; normals: (n, 3) float32, weighted by their length; heat: (n,) float32. Points
    colder than `least` belong to no cell.
    """
    # Large arrays are made here, not in the kernels: NumPy asks for huge pages, which are much faster to begin with.
    number, place, keys = (
        np.empty(len(points), np.int32),
        np.empty(len(points), np.uint16),
        np.empty(len(points), np.int64),
    )
    count: int = find_blocks(points, heat, np.float32(1 / edge), np.float32(least), number, place, keys)
    keys = keys[:count].copy()
    first, cell_at = np.zeros(len(keys) + 1, np.int32), np.full((len(keys), PLACES), NONE)
    number_cells(number, place, first, cell_at)
    cells = int(first[-1])
    sums, cell_place = np.full((cells, 8), np.float32(0)), np.empty(cells, np.uint16)
    _gather(points, normals, heat, number, place, first, cell_at, sums, cell_place)
    centre, normal, mean = np.empty((cells, 3), np.float32), np.empty((cells, 3), np.float32), sums[:, 6] / sums[:, 7]
    _means(sums, centre, normal)
    return Surface(edge, centre, normal, mean, number, Blocks(keys, first, cell_place))


def near_pairs(surface: Surface, member: NDArray[np.bool_] | None = None) -> NDArray[np.uint32]:
    """(m, 2) uint32: pairs of cells no more than two cell edges apart, each pair once.

    member: (n,) bool, cells that take part; default: all.
    """
    blocks = surface.blocks
    if member is None:
        member = np.ones(len(blocks.place), np.bool_)
    member_at = np.full((len(blocks.first), PLACES), NONE)
    pairs = np.empty((len(blocks.place) * STEPS + 1, 2), np.uint32)
    count: int = enter_pairs(blocks.keys, blocks.first, blocks.place, member, member_at, pairs)
    return pairs[:count]


def cells_around(surface: Surface, coarse: Surface) -> NDArray[np.int32]:
    """For each cell of a surface, a cell of a coarser one of the same points that holds points of it: (n,) int32."""
    around = np.empty(len(surface.centre), np.int32)
    held = surface.cell_of_point >= 0
    around[surface.cell_of_point[held]] = coarse.cell_of_point[held]
    return around


def points_of_cells(surface: Surface, group: NDArray[np.int32], groups: int) -> list[NDArray[np.int64]]:
    """The rows of the points of each group of cells. group: (n,) int32, 0 to groups - 1, -1 = none."""
    rows, borders = np.empty(len(surface.cell_of_point), np.int64), np.zeros(groups + 1, np.int64)
    _rows_of_groups(surface.cell_of_point, group, rows, borders)
    return [rows[begin:end] for begin, end in pairwise(borders)]


@nb.njit(
    "void(f4[:,::1], f4[:,::1], f4[::1], i4[::1], u2[::1], i4[::1], u2[:,::1], f4[:,::1], u2[::1])",
    cache=True,
    nogil=True,
)
def _gather(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    heat: NDArray[np.float32],
    number: NDArray[np.int32],
    place_of_point: NDArray[np.uint16],
    first: NDArray[np.int32],
    cell_at: NDArray[np.uint16],
    sums: NDArray[np.float32],
    place_of_cell: NDArray[np.uint16],
) -> None:
    """Sums a cell (position, normal, heat, count), and its place. number: each point's block becomes its cell."""
    for i in range(len(points)):
        block, place = number[i], place_of_point[i]
        if block < 0:
            continue
        cell = np.uint32(first[block] + cell_at[np.uint32(block), place])
        number[i] = cell
        place_of_cell[cell] = place
        for axis in range(3):
            sums[cell, axis] += points[i, axis]
            sums[cell, 3 + axis] += normals[i, axis]
        sums[cell, 6] += heat[i]
        sums[cell, 7] += np.float32(1)


@nb.njit("void(f4[:,::1], f4[:,::1], f4[:,::1])", cache=True, nogil=True)
def _means(sums: NDArray[np.float32], centre: NDArray[np.float32], normal: NDArray[np.float32]) -> None:
    """Centres and unit normals from the sums of `_gather`."""
    for cell in range(len(sums)):
        x, y, z, count = sums[cell, 3], sums[cell, 4], sums[cell, 5], sums[cell, 7]
        length = max(np.sqrt(x * x + y * y + z * z), np.float32(1e-9))
        for axis in range(3):
            centre[cell, axis] = sums[cell, axis] / count
            normal[cell, axis] = sums[cell, 3 + axis] / length


@nb.njit("void(i4[::1], i4[::1], i8[::1], i8[::1])", cache=True, nogil=True)
def _rows_of_groups(
    cell_of_point: NDArray[np.int32],
    group: NDArray[np.int32],
    rows: NDArray[np.int64],
    borders: NDArray[np.int64],
) -> None:
    """The points sorted by their cell's group, and where each group begins and the last one ends."""
    for cell in cell_of_point:
        if cell >= 0 and group[cell] >= 0:
            borders[group[cell] + 1] += 1
    for number in range(1, len(borders)):
        borders[number] += borders[number - 1]
    filled = borders.copy()
    for i in range(len(cell_of_point)):
        cell = cell_of_point[i]
        if cell >= 0 and group[cell] >= 0:
            rows[filled[group[cell]]] = i
            filled[group[cell]] += 1
