"""The hash table in which maps look up what lies in a voxel: open addressing, with linear probing."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

EMPTY = np.int64(-1)


def empty_table(limit: int) -> NDArray[np.int64]:
    """(slots,) int64, EMPTY: a table for `limit` keys, which is never more than half full."""
    return np.full(1 << int(np.ceil(np.log2(2 * limit))), EMPTY)


@kernel("i8(i8, i8, i8, i8)", forceinline=True)
def voxel_key(i: np.int64, j: np.int64, k: np.int64, side: int) -> np.int64:
    """A voxel's key, 0 or more: integer coordinates, 20 bits each (5 km at 5 mm), and a number 0..7 of its entry."""
    half, mask = np.int64(1 << 19), np.int64(0xFFFFF)
    i, j, k = (i + half) & mask, (j + half) & mask, (k + half) & mask
    return ((i << np.int64(20) | j) << np.int64(20) | k) << np.int64(3) | np.int64(side)


@kernel("u8(i8[::1], i8)", forceinline=True)
def home_slot(keys: NDArray[np.int64], key: np.int64) -> np.uint64:
    """Slot at which the search for a key begins."""
    mask, place = np.uint64(len(keys) - 1), np.uint64(key)
    return ((place ^ (place >> np.uint64(29))) * np.uint64(0x2545F4914F6CDD1D) >> np.uint64(20)) & mask


@kernel("u8(i8[::1], i8)", forceinline=True)
def find_slot(keys: NDArray[np.int64], key: np.int64) -> np.uint64:
    """Slot that holds the key, or the free slot where it belongs."""
    # Unsigned: numba then need not check an index for counting from the end.
    mask, slot = np.uint64(len(keys) - 1), home_slot(keys, key)
    while keys[slot] != EMPTY and keys[slot] != key:
        slot = (slot + np.uint64(1)) & mask
    return slot
