"""Where the cells of a surface are: blocks of 6 x 6 x 6, which are themselves the cells of a coarser surface.

Only the blocks are looked up by hash, and the cells of a block are neighbours in memory too: what walks along the
surface finds most of what it needs in the processor's cache.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.heatmap3d import find_slot
from spot3d.kernel import kernel

SIDE = 6
"""Cells along a block's edge: a block's places, and one more value for none, fit a byte."""
PLACES = SIDE**3
NONE = np.uint8(0xFF)
"""Where a block has no cell."""
_AXES = np.array([1 << 42, 1 << 21, 1])
"""A place in the world is packed into one integer, 21 bits an axis (10 km at 5 mm: nothing wraps indoors)."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Where cells are, in the order of their blocks.

    around: (blocks, 18) int32, the blocks around each that are not before it along the first axis, and itself; where
    there is none, the number of blocks. first: (blocks + 1,) int32, its first cell; place: (cells,) uint8, of each
    cell in its block.
    """

    around: NDArray[np.int32]
    first: NDArray[np.int32]
    place: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.around)

    def of_cells(self) -> NDArray[np.int32]:
        """The block of each cell, (cells,) int32."""
        return np.repeat(np.arange(len(self), dtype=np.int32), np.diff(self.first))

    def cells_around(self, wanted: NDArray[np.bool_]) -> NDArray[np.int32]:
        """The cells around each cell, (cells, 18) int32: what `around` is where it is a block of smaller ones.

        wanted: (cells,) bool, those that hold smaller ones; around the others anything may be.
        """
        around = np.empty((len(self.place), _SIDES), np.int32)
        _cells_around(self.around, self.first, self.place, self.cell_at(), wanted, around)
        return around

    def cell_at(self) -> NDArray[np.uint8]:
        """The cell at each place of each block and of one more that is empty, (blocks + 1, places), from its first."""
        table = np.full((len(self) + 1, PLACES), NONE)
        _enter(self.first, self.place, table)
        return table


def _xyz(places: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, 3) coordinates of places in a block."""
    xyz: NDArray[np.int64] = np.stack(np.unravel_index(places, (SIDE,) * 3), -1)
    return xyz


def _half_ball() -> NDArray[np.int64]:
    """Steps to the cells within two edges, one of each opposite pair: (16, 3)."""
    steps = np.arange(-2, 3)
    offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    later = offsets[len(offsets) // 2 + 1 :]
    half: NDArray[np.int64] = later[(later**2).sum(1) <= 4]
    return half


def _steps(steps: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """From each place of a block by each step: which of the 18 blocks around, and the place there.

    steps: (k, 3), never backwards along the first axis.
    """
    reached = _xyz(np.arange(PLACES))[:, None] + steps
    block = (reached // SIDE + (0, 1, 1)) @ (9, 3, 1)
    place = (reached % SIDE) @ (SIDE**2, SIDE, 1)
    return block.astype(np.uint8), place.astype(np.uint8)


_SIDES = 18
"""Blocks around a block that are not before it along the first axis, and itself."""
_SIDE_STEP = np.stack(np.unravel_index(np.arange(_SIDES), (2, 3, 3)), -1) - (0, 1, 1)
_STEP_BLOCK, _STEP_PLACE = _steps(_half_ball())
_SIDE_BLOCK, _SIDE_PLACE = _steps(_SIDE_STEP)
STEPS = _STEP_PLACE.shape[1]
"""Cells within two edges of a cell, one of each opposite pair."""


@kernel("Tuple((i8[::1], i4[::1]))(i8[::1], i8)")
def _table(keys: NDArray[np.int64], room: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """A hash table of the keys and their numbers, with room for so many at most a quarter full."""
    slots = 64
    while slots < 4 * room:
        slots *= 2
    table, numbers = np.full(slots, np.int64(-1)), np.empty(slots, np.int32)
    for number in range(len(keys)):
        slot = find_slot(table, keys[number])
        table[slot], numbers[slot] = keys[number], number
    return table, numbers


@kernel("void(f4[:,::1], f4, u1[::1], u1[::1], i8[::1])")
def _pack(
    points: NDArray[np.float32],
    per_metre: np.float32,
    outer_place: NDArray[np.uint8],
    place: NDArray[np.uint8],
    keys: NDArray[np.int64],
) -> None:
    """Each point's places, and the key of its outer block (see `find_blocks`)."""
    # In 32 bits and axis by axis, so that several points are computed at once.
    side, half = np.uint32(SIDE), np.int32((1 << 20) // SIDE**2 * SIDE**2)
    for i in range(len(points)):
        x = np.uint32(np.int32(np.floor(points[i, 0] * per_metre)) + half)
        y = np.uint32(np.int32(np.floor(points[i, 1] * per_metre)) + half)
        z = np.uint32(np.int32(np.floor(points[i, 2] * per_metre)) + half)
        u, v, w = np.uint32(x // side), np.uint32(y // side), np.uint32(z // side)
        a, b, c = np.uint32(u // side), np.uint32(v // side), np.uint32(w // side)
        place[i] = np.uint32(np.uint32(x - u * side) * side + (y - v * side)) * side + (z - w * side)
        outer_place[i] = np.uint32(np.uint32(u - a * side) * side + (v - b * side)) * side + (w - c * side)
        key = (np.int64(a) << np.int64(42)) | (np.int64(b) << np.int64(21)) | np.int64(c)
        keys[i] = key & np.int64(0x7FFFFFFFFFFFFFFF)  # -1 is no key, however far the point


@kernel("i8(i8[::1], i8, i8[::1], i4[::1], i4[::1])")
def _look_up(
    keys: NDArray[np.int64],
    begin: int,
    table: NDArray[np.int64],
    numbers: NDArray[np.int32],
    number_of_key: NDArray[np.int32],
) -> int:
    """Enter the numbers of the keys from `begin` on; returns where the first one is that the table does not hold."""
    for i in range(begin, len(keys)):
        slot = find_slot(table, keys[i])
        if table[slot] == np.int64(-1):
            return i
        number_of_key[i] = numbers[slot]
    return len(keys)


@kernel("i8(f4[:,::1], f4, i4[::1], u1[::1], u1[::1], i8[::1])")
def find_blocks(
    points: NDArray[np.float32],
    per_metre: np.float32,
    block_of_point: NDArray[np.int32],
    outer_place: NDArray[np.uint8],
    place: NDArray[np.uint8],
    keys: NDArray[np.int64],
) -> int:
    """Where points are at three sizes: cells, blocks of cells, and blocks of blocks.

    Enters each point's place in its block, the block's place in its outer block, the outer block's number, and those
    blocks' keys in the order of their first points. Returns how many they are. per_metre: cells.
    """
    _pack(points, per_metre, outer_place, place, keys)
    table, numbers = _table(keys[:0], 0)
    count = 0
    done = _look_up(keys, 0, table, numbers, block_of_point)
    while done < len(points):
        if 4 * count >= len(table):
            table, numbers = _table(keys[:count], 2 * count)
        slot = find_slot(table, keys[done])
        table[slot], numbers[slot], keys[count] = keys[done], count, keys[done]  # the keys before are all read
        count += 1
        done = _look_up(keys, done, table, numbers, block_of_point)
    return count


def find_around(keys: NDArray[np.int64]) -> NDArray[np.int32]:
    """Which blocks are around each (see `Blocks`), from their packed places."""
    around = np.empty((len(keys), _SIDES), np.int32)
    _find_around(keys, _SIDE_STEP @ _AXES, around)
    return around


def number_cells(
    blocks: int,
    block_of_point: NDArray[np.int32],
    place: NDArray[np.uint8],
    heat: NDArray[np.float32],
    least: float,
) -> tuple[NDArray[np.int32], NDArray[np.uint8], NDArray[np.int32]]:
    """The cells that hold points at least so hot, numbered block by block: `first` and `place` (see `Blocks`).

    And the cell of each point, -1 = none. blocks: how many they are.
    """
    # Large arrays are made here, not in the kernels: NumPy asks for huge pages, which are much faster to begin with.
    cell_of_point, place_of_cell = np.empty(len(place), np.int32), np.empty(len(place), np.uint8)
    first, cell_at = np.zeros(blocks + 1, np.int32), np.full((blocks, PLACES), NONE)
    _number_cells(block_of_point, place, heat, np.float32(least), first, cell_at, cell_of_point, place_of_cell)
    return first, place_of_cell[: first[-1]].copy(), cell_of_point


@kernel("void(i4[::1], u1[::1], f4[::1], f4, i4[::1], u1[:,::1], i4[::1], u1[::1])")
def _number_cells(
    block_of_point: NDArray[np.int32],
    place: NDArray[np.uint8],
    heat: NDArray[np.float32],
    least: np.float32,
    first: NDArray[np.int32],
    cell_at: NDArray[np.uint8],
    cell_of_point: NDArray[np.int32],
    place_of_cell: NDArray[np.uint8],
) -> None:
    """Number the cells of each block at its places, in the order of their first points, and the first of each block."""
    for i in range(len(block_of_point)):
        block, at = np.uint32(block_of_point[i]), place[i]
        cell_of_point[i] = -1
        if heat[i] >= least:
            if cell_at[block, at] == NONE:
                cell_at[block, at] = first[block + 1]
                first[block + 1] += 1
            cell_of_point[i] = cell_at[block, at]
    for before in range(len(first) - 1):
        first[before + 1] += first[before]
    for i in range(len(block_of_point)):
        if cell_of_point[i] >= 0:
            cell_of_point[i] += first[np.uint32(block_of_point[i])]
            place_of_cell[cell_of_point[i]] = place[i]


@kernel("void(i8[::1], i8[::1], i4[:,::1])")
def _find_around(keys: NDArray[np.int64], steps: NDArray[np.int64], around: NDArray[np.int32]) -> None:
    """Look up which blocks are around each (see `Blocks`). keys: packed places; steps: ways to the 18 blocks around."""
    table, numbers = _table(keys, len(keys))
    for block in range(len(keys)):
        for side in range(len(steps)):
            slot = find_slot(table, keys[block] + steps[side])
            around[block, side] = numbers[slot] if table[slot] != np.int64(-1) else len(keys)


@kernel("void(i4[::1], u1[::1], u1[:,::1])")
def _enter(first: NDArray[np.int32], place: NDArray[np.uint8], cell_at: NDArray[np.uint8]) -> None:
    """Enter the cells at their places (see `Blocks.cell_at`)."""
    for block in range(len(first) - 1):
        for cell in range(first[block], first[block + 1]):
            cell_at[block, place[cell]] = cell - first[block]


@kernel("void(i4[:,::1], i4[::1], u1[::1], u1[:,::1], b1[::1], i4[:,::1])")
def _cells_around(
    around: NDArray[np.int32],
    first: NDArray[np.int32],
    place: NDArray[np.uint8],
    cell_at: NDArray[np.uint8],
    wanted: NDArray[np.bool_],
    cells_around: NDArray[np.int32],
) -> None:
    """See `Blocks.cells_around`."""
    for block in range(len(around)):
        for cell in range(first[block], first[block + 1]):
            for side in range(around.shape[1] if wanted[cell] else 0):
                other = np.uint32(around[block, _SIDE_BLOCK[place[cell], side]])
                number = cell_at[other, _SIDE_PLACE[place[cell], side]]
                cells_around[cell, side] = first[other] + number if number != NONE else len(place)


@kernel("i8(i4[:,::1], i4[::1], u1[::1], u1[:,::1], u4[:,::1])")
def enter_pairs(
    around: NDArray[np.int32],
    first: NDArray[np.int32],
    place_of_cell: NDArray[np.uint8],
    cell_at: NDArray[np.uint8],
    pairs: NDArray[np.uint32],
) -> int:
    """Look up the surroundings of each cell, and say how many pairs that are. cell_at: see `Blocks.cell_at`."""
    count = np.uint64(0)  # without a sign, an index is not looked at for counting from the end
    for block in range(len(around)):
        for cell in range(first[block], first[block + 1]):
            place = place_of_cell[cell]
            for step in range(STEPS):
                other = np.uint32(around[block, _STEP_BLOCK[place, step]])
                number = cell_at[other, _STEP_PLACE[place, step]]
                # Always written and then perhaps passed over: a branch would mostly be guessed wrong.
                pairs[count, 0] = cell
                pairs[count, 1] = first[other] + number
                count += np.uint64(number != NONE)
    return int(count)
