"""The arrays of the 3D heatmap, as its kernels see them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.voxel_hash import EMPTY, home_slot, voxel_key

# Columns of a map row; 6 to 8 are free. A row fills one cache line, so that updating a point costs one memory access.
X, R, WEIGHT, HEAT, FREQUENCY, LAST, FIRST = 0, 3, 9, 10, 11, 12, 13
COLUMNS = 16


class MapArrays(NamedTuple):
    """The arrays of the map.

    rows: (limit, 16) float32, of which the first `used` have held points: position in the world (metres), colour
    (RGB 0..255), weight of the running means, consolidated heat c, frequency f (0: the row is free), number of the
    frame that saw the point first, modulo 2^24; numbers: (limit, 16) int32, the same memory: its column LAST is the
    number of the frame that saw the point last.
    keys: (slots,) int64 voxels, -1 = free; slot_rows: (slots,) int32 row of each key; row_slots: (limit,) int32 slot of
    each row's key, -1 = none. free: (limit,) int32, of which the first `free_count` are the rows that points have left.
    counts: (2,) int64, `used` and `free_count`.
    """

    rows: NDArray[np.float32]
    numbers: NDArray[np.int32]
    keys: NDArray[np.int64]
    slot_rows: NDArray[np.int32]
    row_slots: NDArray[np.int32]
    free: NDArray[np.int32]
    counts: NDArray[np.int64]


@kernel("i8(f4, f4, f4, f4)", forceinline=True)
def key_at(x: np.float32, y: np.float32, z: np.float32, per_metre: np.float32) -> np.int64:
    """Key of the voxel that contains a point of the world."""
    i, j, k = np.floor(x * per_metre), np.floor(y * per_metre), np.floor(z * per_metre)
    return voxel_key(np.int64(i), np.int64(j), np.int64(k), 0)


@kernel("void(u8, i8[::1], i4[::1], i4[::1])")
def remove_key(
    slot: np.uint64, keys: NDArray[np.int64], slot_rows: NDArray[np.int32], row_slots: NDArray[np.int32]
) -> None:
    """Free a slot, and move back the displaced keys behind it (Knuth 6.4, algorithm R)."""
    mask, hole = np.uint64(len(keys) - 1), slot
    while True:
        slot = (slot + np.uint64(1)) & mask
        if keys[slot] == EMPTY:
            break
        if (slot - home_slot(keys, keys[slot])) & mask >= (slot - hole) & mask:
            keys[hole], slot_rows[hole] = keys[slot], slot_rows[slot]
            row_slots[slot_rows[hole]] = hole
            hole = slot
    keys[hole] = EMPTY
