"""Where the cells of a surface are: blocks of 8 x 8 x 8.

Only the blocks are looked up by hash, and the cells of a block are neighbours in memory too: what walks along the
surface finds most of what it needs in the processor's cache.
"""

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.heatmap3d import find_slot, voxel_key

_SIDE = 8
"""Cells along a block's edge: a power of two, so that a key's lowest bits are the place in the block."""
PLACES = _SIDE**3
NONE = np.uint16(0xFFFF)
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


def _half_ball() -> NDArray[np.int64]:
    """Steps to the cells within two edges, one of each opposite pair: (16, 3)."""
    steps = np.arange(-2, 3)
    offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    later = offsets[len(offsets) // 2 + 1 :]
    half: NDArray[np.int64] = later[(later**2).sum(1) <= 4]
    return half


def _steps() -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """From each place of a block by each step of the half ball: which of the 27 blocks around, and the place there."""
    places = np.stack(np.unravel_index(np.arange(PLACES), (_SIDE,) * 3), -1)
    reached = places[:, None] + _half_ball()
    block = (reached // _SIDE + 1) @ (9, 3, 1)
    place = (reached % _SIDE) @ (_SIDE**2, _SIDE, 1)
    return block.astype(np.uint8), place.astype(np.uint16)


_STEP_BLOCK, _STEP_PLACE = _steps()
STEPS = _STEP_PLACE.shape[1]
"""Cells within two edges of a cell, one of each opposite pair."""


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
def find_blocks(
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
def number_cells(
    block_of_point: NDArray[np.int32],
    place_of_point: NDArray[np.uint16],
    first: NDArray[np.int32],
    cell_at: NDArray[np.uint16],
) -> None:
    """Number the cells of each block at its places, in the order of their first points, and the first of each block."""
    for i in range(len(block_of_point)):
        block, place = block_of_point[i], place_of_point[i]
        if block >= 0 and cell_at[np.uint32(block), place] == NONE:
            cell_at[np.uint32(block), place] = first[block + 1]
            first[block + 1] += 1
    for block in range(len(cell_at)):
        first[block + 1] += first[block]


@nb.njit("i8(i8[::1], i4[::1], u2[::1], b1[:], u2[:,::1], u4[:,::1])", cache=True, nogil=True)
def enter_pairs(
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
            for step in range(STEPS):
                side = _STEP_BLOCK[place, step]
                number = member_at[around[side], _STEP_PLACE[place, step]]
                # Always written and then perhaps passed over: a branch would mostly be guessed wrong.
                pairs[count, 0] = cell
                pairs[count, 1] = first_around[side] + number
                count += np.uint64(number != NONE)
    return int(count)
