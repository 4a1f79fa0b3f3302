"""The map's surface as small cells, and which of them are near: what segmentation works on.

Cells are kept in blocks of 8 x 8 x 8. Only the blocks are looked up by hash, and the cells of a block are
neighbours in memory too: what walks along the surface finds most of what it needs in the processor's cache.
"""

from dataclasses import dataclass
from itertools import pairwise

import numba as nb
import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.heatmap3d import find_slot, voxel_key

_SIDE = 8
"""Cells along a block's edge: a power of two, so that a key's lowest bits are the place in the block."""
_PLACES = _SIDE**3
_NONE = np.uint16(0xFFFF)
"""Where a block has no cell."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Where cells are, in the order of their blocks.

    keys: (blocks,) int64, packed place of each block; first: (blocks + 1,) int32, its first cell; place: (cells,)
    uint16, of each cell in its block.
    """

    keys: NDArray[np.int64]
    first: NDArray[np.int32]
    place: NDArray[np.uint16]


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
    count: int = _find_blocks(points, heat, np.float32(1 / edge), np.float32(least), number, place, keys)
    keys = keys[:count].copy()
    first, cell_at = np.zeros(len(keys) + 1, np.int32), np.full((len(keys), _PLACES), _NONE)
    _number_cells(number, place, first, cell_at)
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
    member_at = np.full((len(blocks.first), _PLACES), _NONE)
    pairs = np.empty((len(blocks.place) * _STEP_PLACE.shape[1] + 1, 2), np.uint32)
    count: int = _near_pairs(blocks.keys, blocks.first, blocks.place, member, member_at, pairs)
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


def _half_ball() -> NDArray[np.int64]:
    """Steps to the cells within two edges, one of each opposite pair: (16, 3)."""
    steps = np.arange(-2, 3)
    offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    later = offsets[len(offsets) // 2 + 1 :]
    half: NDArray[np.int64] = later[(later**2).sum(1) <= 4]
    return half


def _steps() -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """From each place of a block by each step of the half ball: which of the 27 blocks around, and the place there."""
    places = np.stack(np.unravel_index(np.arange(_PLACES), (_SIDE,) * 3), -1)
    reached = places[:, None] + _half_ball()
    block = (reached // _SIDE + 1) @ (9, 3, 1)
    place = (reached % _SIDE) @ (_SIDE**2, _SIDE, 1)
    return block.astype(np.uint8), place.astype(np.uint16)


_STEP_BLOCK, _STEP_PLACE = _steps()


@nb.njit("Tuple((i8[::1], i4[::1]))(i8[::1], i8)", cache=True, nogil=True)
def _table(keys: NDArray[np.int64], room: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """A hash table of the keys and their numbers, with room for so many at most half full."""
    slots = 64
    while slots < 2 * room:
        slots *= 2
    table, numbers = np.full(slots, np.int64(-1)), np.empty(slots, np.int32)
    for number in range(len(keys)):
        slot = find_slot(table, keys[number])
        table[slot], numbers[slot] = keys[number], number
    return table, numbers


@nb.njit("i8(f4[:,::1], f4[::1], f4, f4, i4[::1], u2[::1], i8[::1])", cache=True, nogil=True)
def _find_blocks(
    points: NDArray[np.float32],
    heat: NDArray[np.float32],
    per_metre: np.float32,
    least: np.float32,
    block_of_point: NDArray[np.int32],
    place_of_point: NDArray[np.uint16],
    keys: NDArray[np.int64],
) -> int:
    """Each point's block (-1 = too cold) and place there, and the blocks' keys in the order of their first points."""
    table, numbers = _table(keys[:0], 0)
    low = np.int64(_SIDE - 1)
    high = ~((low << np.int64(42)) | (low << np.int64(21)) | low)
    count, block, last = 0, np.int32(-1), np.int64(-1)
    for i in range(len(points)):
        block_of_point[i] = -1
        if heat[i] < least:
            continue
        key = voxel_key(points[i, 0], points[i, 1], points[i, 2], per_metre)
        x, y, z = (key >> np.int64(42)) & low, (key >> np.int64(21)) & low, key & low
        place_of_point[i] = (x * _SIDE + y) * _SIDE + z
        key &= high
        if key != last:  # neighbours on the map are mostly neighbours in space
            if 2 * count >= len(table):
                table, numbers = _table(keys[:count], 2 * count)
            slot = find_slot(table, key)
            if table[slot] == np.int64(-1):
                table[slot], numbers[slot], keys[count] = key, count, key
                count += 1
            block, last = numbers[slot], key
        block_of_point[i] = block
    return count


@nb.njit("void(i4[::1], u2[::1], i4[::1], u2[:,::1])", cache=True, nogil=True)
def _number_cells(
    block_of_point: NDArray[np.int32],
    place_of_point: NDArray[np.uint16],
    first: NDArray[np.int32],
    cell_at: NDArray[np.uint16],
) -> None:
    """Number the cells of each block at its places, in the order of their first points, and the first of each block."""
    for i in range(len(block_of_point)):
        block, place = block_of_point[i], place_of_point[i]
        if block >= 0 and cell_at[np.uint32(block), place] == _NONE:
            cell_at[np.uint32(block), place] = first[block + 1]
            first[block + 1] += 1
    for block in range(len(cell_at)):
        first[block + 1] += first[block]


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


@nb.njit("i8(i8[::1], i4[::1], u2[::1], b1[:], u2[:,::1], u4[:,::1])", cache=True, nogil=True)
def _near_pairs(
    keys: NDArray[np.int64],
    first: NDArray[np.int32],
    place_of_cell: NDArray[np.uint16],
    member: NDArray[np.bool_],
    member_at: NDArray[np.uint16],
    pairs: NDArray[np.uint32],
) -> int:
    """Enter the members at their places, look up the 27 blocks around each block, and its cells' surroundings there.

    member_at: one block more than there are, all empty.
    """
    for block in range(len(keys)):
        for cell in range(first[block], first[block + 1]):
            if member[cell]:
                member_at[block, place_of_cell[cell]] = cell - first[block]
    table, numbers = _table(keys, len(keys))
    around, first_around = np.empty(27, np.uint32), np.empty(27, np.int32)
    count = np.uint64(0)  # without a sign, an index is not looked at for counting from the end
    for block in range(len(keys)):
        for side in range(27):
            x, y, z = np.int64(side // 9 - 1), np.int64(side // 3 % 3 - 1), np.int64(side % 3 - 1)
            key = keys[block] + ((x << np.int64(42)) + (y << np.int64(21)) + z) * np.int64(_SIDE)
            slot = find_slot(table, key)
            around[side] = numbers[slot] if table[slot] != np.int64(-1) else len(keys)
            first_around[side] = first[around[side]]
        for cell in range(first[block], first[block + 1]):
            if not member[cell]:
                continue
            place = place_of_cell[cell]
            for step in range(_STEP_PLACE.shape[1]):
                side = _STEP_BLOCK[place, step]
                number = member_at[around[side], _STEP_PLACE[place, step]]
                # Always written and then perhaps passed over: a branch would mostly be guessed wrong.
                pairs[count, 0] = cell
                pairs[count, 1] = first_around[side] + number
                count += np.uint64(number != _NONE)
    return int(count)


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
