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

    keys: (blocks,) int64, packed place of each block; first: (blocks + 1,) int32, its first cell; place: (cells,)
    uint8, of each cell in its block.
    """

    keys: NDArray[np.int64]
    first: NDArray[np.int32]
    place: NDArray[np.uint8]

    def of_cells(self) -> NDArray[np.int32]:
        """The block of each cell, (cells,) int32."""
        return np.repeat(np.arange(len(self.keys), dtype=np.int32), np.diff(self.first))

    def cell_keys(self) -> NDArray[np.int64]:
        """Packed place of each cell, (cells,) int64: its key where it is itself a block, of smaller cells."""
        keys: NDArray[np.int64] = SIDE * self.keys[self.of_cells()] + _PLACE_KEY[self.place]
        return keys


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


def _steps() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """From each place of a block by each step of the half ball: which of the 18 blocks around, and the place there."""
    reached = _xyz(np.arange(PLACES))[:, None] + _half_ball()  # never backwards along the first axis
    block = (reached // SIDE + (0, 1, 1)) @ (9, 3, 1)
    place = (reached % SIDE) @ (SIDE**2, SIDE, 1)
    return block.astype(np.uint8), place.astype(np.uint8)


_PLACE_KEY = _xyz(np.arange(PLACES)) @ _AXES
_STEP_BLOCK, _STEP_PLACE = _steps()
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
    side, half = np.uint64(SIDE), np.int64((1 << 20) // SIDE**2 * SIDE**2)
    table, numbers = _table(keys[:0], 0)
    count = 0
    for i in range(len(points)):
        packed, outer, inner = np.uint64(0), np.uint64(0), np.uint64(0)
        for axis in range(3):
            cell = np.uint64(np.int64(np.floor(points[i, axis] * per_metre)) + half)
            block = cell // side
            around = block // side
            inner = inner * side + (cell - block * side)
            outer = outer * side + (block - around * side)
            packed = packed << np.uint64(21) | around
        place[i], outer_place[i], key = inner, outer, np.int64(packed)
        slot = find_slot(table, key)
        if table[slot] == np.int64(-1):
            if 4 * count >= len(table):
                table, numbers = _table(keys[:count], 2 * count)
                slot = find_slot(table, key)
            table[slot], numbers[slot], keys[count] = key, count, key
            count += 1
        block_of_point[i] = numbers[slot]
    return count


def number_cells(
    keys: NDArray[np.int64],
    block_of_point: NDArray[np.int32],
    place: NDArray[np.uint8],
    heat: NDArray[np.float32],
    least: float,
) -> tuple[Blocks, NDArray[np.int32]]:
    """The cells that hold points at least so hot, numbered block by block, and the cell of each point, -1 = none."""
    # Large arrays are made here, not in the kernels: NumPy asks for huge pages, which are much faster to begin with.
    cell_of_point, place_of_cell = np.empty(len(place), np.int32), np.empty(len(place), np.uint8)
    first, cell_at = np.zeros(len(keys) + 1, np.int32), np.full((len(keys), PLACES), NONE)
    _number_cells(block_of_point, place, heat, np.float32(least), first, cell_at, cell_of_point, place_of_cell)
    return Blocks(keys, first, place_of_cell[: first[-1]].copy()), cell_of_point


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


@kernel("i8(i8[::1], i4[::1], u1[::1], b1[:], u1[:,::1], u4[:,::1])")
def enter_pairs(
    keys: NDArray[np.int64],
    first: NDArray[np.int32],
    place_of_cell: NDArray[np.uint8],
    member: NDArray[np.bool_],
    member_at: NDArray[np.uint8],
    pairs: NDArray[np.uint32],
) -> int:
    """Enter the members at their places, look up the 18 blocks around each block, and its cells' surroundings there.

    member_at: one block more than there are, all empty.
    """
    for block in range(len(keys)):
        for cell in range(first[block], first[block + 1]):
            if member[cell]:
                member_at[block, place_of_cell[cell]] = cell - first[block]
    table, numbers = _table(keys, len(keys))
    around, first_around = np.empty(18, np.uint32), np.empty(18, np.int32)
    count = np.uint64(0)  # without a sign, an index is not looked at for counting from the end
    for block in range(len(keys)):
        if not member[first[block] : first[block + 1]].any():
            continue
        for side in range(18):
            x, y, z = np.int64(side // 9), np.int64(side // 3 % 3 - 1), np.int64(side % 3 - 1)
            slot = find_slot(table, keys[block] + (x << np.int64(42)) + (y << np.int64(21)) + z)
            around[side] = numbers[slot] if table[slot] != np.int64(-1) else len(keys)
            first_around[side] = first[around[side]]
        for cell in range(first[block], first[block + 1]):
            if not member[cell]:
                continue
            place = place_of_cell[cell]
            for step in range(STEPS):
                side = _STEP_BLOCK[place, step]
                number = member_at[around[side], _STEP_PLACE[place, step]]
                # Always written and then perhaps passed over: a branch would mostly be guessed wrong.
                pairs[count, 0] = cell
                pairs[count, 1] = first_around[side] + number
                count += np.uint64(number != NONE)
    return int(count)
