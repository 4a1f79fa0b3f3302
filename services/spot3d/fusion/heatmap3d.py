"""The 3D heatmap H_3D: points with colour, normal, heat and frequency, found again by voxel (paper, Sec. IV-A)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

# Columns of a map row. A row fills one cache line, so that updating a point costs one memory access.
X, R, NORMAL, WEIGHT, HEAT, FREQUENCY, LAST = 0, 3, 6, 9, 10, 11, 12
COLUMNS = 16

_EMPTY = np.int64(-1)


class Heatmap3D:
    """Bounded point map with a voxel hash.

    rows: (limit, 16) float32, of which the first `count` are in use: position in the world (metres), colour
    (RGB 0..255), normal (sum of unit normals, towards the cameras), weight of the running means, consolidated
    heat c, frequency f, number of the frame that saw the point last.
    keys: (slots,) int64 packed voxel coordinates, -1 = free; slot_rows: (slots,) int32 row of each key.
    """

    def __init__(self, limit: int, voxel: float) -> None:
        self.limit = limit
        self.voxel = voxel
        # Untouched pages of these arrays cost no memory, so the map pays only for the points it holds.
        self.rows = np.empty((limit, COLUMNS), np.float32)
        slots = 1 << int(np.ceil(np.log2(2 * limit)))
        self.keys = np.full(slots, _EMPTY)
        self.slot_rows = np.empty(slots, np.int32)
        self.count = 0
        self.evicted = 0

    def points(self) -> NDArray[np.float32]:
        """View of the rows in use, (count, 16) float32."""
        return self.rows[: self.count]

    def clear(self) -> None:
        """Forget every point."""
        self.count = self.evicted = 0
        self.keys.fill(_EMPTY)

    def evict(self, share: float, tau: float) -> NDArray[np.int32]:
        """Drop the least useful `share` of the points; returns (old count,) int32 new rows, -1 = dropped.

        Least useful: low pseudo-average confidence c / (f + tau), with the points seen last held dearest at
        equal confidence, so that what the camera looks at now is not what goes.
        """
        rows = self.points()
        useful = rows[:, HEAT] / (rows[:, FREQUENCY] + tau)
        recent = rows[:, LAST] / max(1.0, float(rows[:, LAST].max(initial=0)))
        dropped = int(share * self.count)
        keep = np.ones(self.count, np.bool_)
        # Clipped because argpartition knows no place beyond the last, not even where all points go.
        keep[np.argpartition(useful + recent, min(dropped, self.count - 1))[:dropped]] = False
        moved = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
        kept = rows[keep]
        self.rows[: len(kept)] = kept
        self.count = len(kept)
        self.evicted += dropped
        self.keys.fill(_EMPTY)
        _insert_all(self.rows, self.count, self.keys, self.slot_rows, np.float32(1 / self.voxel))
        return moved


@kernel("i8(f4, f4, f4, f4)", forceinline=True)
def voxel_key(x: np.float32, y: np.float32, z: np.float32, per_metre: np.float32) -> np.int64:
    """Voxel of a point, 21 bits an axis packed into one integer (10 km at 5 mm: nothing wraps indoors)."""
    half = np.int64(1 << 20)
    i = np.int64(np.floor(x * per_metre)) + half
    j = np.int64(np.floor(y * per_metre)) + half
    k = np.int64(np.floor(z * per_metre)) + half
    return (i << np.int64(42)) | (j << np.int64(21)) | k


@kernel("u8(i8[::1], i8)", forceinline=True)
def find_slot(keys: NDArray[np.int64], key: np.int64) -> np.uint64:
    """Slot that holds the key, or the free slot where it belongs (linear probing; the table is never full)."""
    # Without a sign, an index is not looked at for counting from the end.
    mask, place = np.uint64(len(keys) - 1), np.uint64(key)
    slot = ((place ^ (place >> np.uint64(29))) * np.uint64(0x2545F4914F6CDD1D) >> np.uint64(20)) & mask
    while keys[slot] != _EMPTY and keys[slot] != key:
        slot = (slot + np.uint64(1)) & mask
    return slot


@kernel("void(f4[:,::1], i8, i8[::1], i4[::1], f4)")
def _insert_all(
    rows: NDArray[np.float32],
    count: int,
    keys: NDArray[np.int64],
    slot_rows: NDArray[np.int32],
    per_metre: np.float32,
) -> None:
    """Enter every row by the voxel of its present position (the first come keeps a shared voxel)."""
    for row in range(count):
        key = voxel_key(rows[row, X], rows[row, X + 1], rows[row, X + 2], per_metre)
        slot = find_slot(keys, key)
        if keys[slot] == _EMPTY:
            keys[slot] = key
            slot_rows[slot] = row
