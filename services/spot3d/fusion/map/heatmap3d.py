"""The 3D heatmap H_3D: points with colour, normal, heat and frequency, found again by voxel (paper, Sec. IV-A)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

# Columns of a map row. A row fills one cache line, so that updating a point costs one memory access.
X, R, NORMAL, WEIGHT, HEAT, FREQUENCY, LAST = 0, 3, 6, 9, 10, 11, 12
COLUMNS = 16

_EMPTY = np.int64(-1)


_EVICTED_SHARE = 0.2
"""Points are evicted from among this share of them, the least useful."""
_SAMPLE = 2000
"""About so many points tell how useful that share is."""


class Heatmap3D:
    """Bounded point map with a voxel hash.

    rows: (limit, 16) float32, of which the first `used` have held points: position in the world (metres), colour
    (RGB 0..255), normal (sum of unit normals, towards the cameras), weight of the running means, consolidated
    heat c, frequency f (0: the row is free), number of the frame that saw the point last.
    keys: (slots,) int64 packed voxel coordinates, -1 = free; slot_rows: (slots,) int32 row of each key;
    row_slots: (limit,) int32 slot of each row's key, -1 = none. free: (limit,) int32, of which the first `free_count`
    are the rows that points have left.
    """

    def __init__(self, limit: int, voxel: float) -> None:
        self.limit = limit
        self.voxel = voxel
        # Untouched pages of these arrays cost no memory, so the map pays only for the points it holds.
        self.rows = np.empty((limit, COLUMNS), np.float32)
        slots = 1 << int(np.ceil(np.log2(2 * limit)))
        self.keys = np.full(slots, _EMPTY)
        self.slot_rows = np.empty(slots, np.int32)
        self.row_slots = np.empty(limit, np.int32)
        self.free = np.empty(limit, np.int32)
        self.used = self.free_count = self.evicted = 0
        self._looked_at = 0

    @property
    def count(self) -> int:
        """How many points there are."""
        return self.used - self.free_count

    def points(self) -> NDArray[np.float32]:
        """View of the rows that have held points, (used, 16) float32; those of frequency 0 are free."""
        return self.rows[: self.used]

    def clear(self) -> None:
        """Forget every point."""
        self.used = self.free_count = self.evicted = self._looked_at = 0
        self.keys.fill(_EMPTY)

    def held(self) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """`points`, and the voxel's key of each, (n,) int64, -1 = none; copied, as plainly as frames want it."""
        slots = self.row_slots[: self.used]
        return self.points().copy(), np.where(slots >= 0, self.keys[slots], _EMPTY)

    def restore(self, rows: NDArray[np.float32], keys: NDArray[np.int64]) -> None:
        """Make the map that of which `held` has returned this, without its free rows; at most `limit` points."""
        self.clear()
        self.used = len(rows)
        self.rows[: self.used] = rows
        self.row_slots[: self.used] = -1
        _enter(keys, self.keys, self.slot_rows, self.row_slots)

    def evict(self, wanted: int, tau: float) -> int:
        """Free the rows of so many of the least useful points, or of a fifth of all; returns of how many.

        Least useful: low pseudo-average confidence c / (f + tau), with the points seen last held dearest at
        equal confidence, so that what the camera looks at now is not what goes. The next call goes on where this
        one ends: no frame waits for more than it needs itself.
        """
        sample = self.points()[:: max(1, self.used // _SAMPLE)]
        sample = sample[sample[:, FREQUENCY] > 0]
        if len(sample) == 0:
            return 0
        latest = max(1.0, float(sample[:, LAST].max()))
        useful = sample[:, HEAT] / (sample[:, FREQUENCY] + tau) + sample[:, LAST] / latest
        before = self.free_count
        self._looked_at, self.free_count = _evict(
            self.points(),
            self._looked_at,
            min(wanted, int(_EVICTED_SHARE * self.count)),
            np.float32(np.quantile(useful, _EVICTED_SHARE)),
            np.float32(latest),
            np.float32(tau),
            self.keys,
            self.slot_rows,
            self.row_slots,
            self.free,
            self.free_count,
        )
        self.evicted += self.free_count - before
        return self.free_count - before


@kernel("i8(f4, f4, f4, f4)", forceinline=True)
def voxel_key(x: np.float32, y: np.float32, z: np.float32, per_metre: np.float32) -> np.int64:
    """Voxel of a point, 21 bits an axis packed into one integer (10 km at 5 mm: nothing wraps indoors)."""
    half = np.int64(1 << 20)
    i = np.int64(np.floor(x * per_metre)) + half
    j = np.int64(np.floor(y * per_metre)) + half
    k = np.int64(np.floor(z * per_metre)) + half
    return (i << np.int64(42)) | (j << np.int64(21)) | k


@kernel("u8(i8[::1], i8)", forceinline=True)
def _home(keys: NDArray[np.int64], key: np.int64) -> np.uint64:
    """Slot at which the search for a key begins."""
    mask, place = np.uint64(len(keys) - 1), np.uint64(key)
    return ((place ^ (place >> np.uint64(29))) * np.uint64(0x2545F4914F6CDD1D) >> np.uint64(20)) & mask


@kernel("u8(i8[::1], i8)", forceinline=True)
def find_slot(keys: NDArray[np.int64], key: np.int64) -> np.uint64:
    """Slot that holds the key, or the free slot where it belongs (linear probing; the table is never full)."""
    # Without a sign, an index is not looked at for counting from the end.
    mask, slot = np.uint64(len(keys) - 1), _home(keys, key)
    while keys[slot] != _EMPTY and keys[slot] != key:
        slot = (slot + np.uint64(1)) & mask
    return slot


@kernel("void(u8, i8[::1], i4[::1], i4[::1])")
def remove_key(
    slot: np.uint64, keys: NDArray[np.int64], slot_rows: NDArray[np.int32], row_slots: NDArray[np.int32]
) -> None:
    """Free a slot, and move back those behind it that were put there because it was taken (Knuth 6.4, algorithm R)."""
    mask, hole = np.uint64(len(keys) - 1), slot
    while True:
        slot = (slot + np.uint64(1)) & mask
        if keys[slot] == _EMPTY:
            break
        if (slot - _home(keys, keys[slot])) & mask >= (slot - hole) & mask:
            keys[hole], slot_rows[hole] = keys[slot], slot_rows[slot]
            row_slots[slot_rows[hole]] = hole
            hole = slot
    keys[hole] = _EMPTY


@kernel("void(i8[::1], i8[::1], i4[::1], i4[::1])")
def _enter(
    wanted: NDArray[np.int64], keys: NDArray[np.int64], slot_rows: NDArray[np.int32], row_slots: NDArray[np.int32]
) -> None:
    """Put the keys of the first rows into the empty table."""
    for row in range(len(wanted)):
        if wanted[row] == _EMPTY:
            continue
        slot = find_slot(keys, wanted[row])
        if keys[slot] == _EMPTY:
            keys[slot], slot_rows[slot], row_slots[row] = wanted[row], row, slot


@kernel("Tuple((i8, i8))(f4[:,::1], i8, i8, f4, f4, f4, i8[::1], i4[::1], i4[::1], i4[::1], i8)")
def _evict(
    rows: NDArray[np.float32],
    begin: int,
    wanted: int,
    least: np.float32,
    latest: np.float32,
    tau: np.float32,
    keys: NDArray[np.int64],
    slot_rows: NDArray[np.int32],
    row_slots: NDArray[np.int32],
    free: NDArray[np.int32],
    free_count: int,
) -> tuple[int, int]:
    """Free rows no more useful than `least`, from row `begin` on and around, until so many are free (see `evict`).

    Returns the row after the last one looked at, and how many rows are free.
    """
    row, full = begin, free_count + wanted
    for _ in range(len(rows)):
        if free_count >= full:
            break
        row = row if row < len(rows) else 0
        frequency = rows[row, FREQUENCY]
        useful = rows[row, HEAT] / (frequency + tau) + rows[row, LAST] / latest
        if frequency > 0 and useful <= least:
            if row_slots[row] >= 0:
                remove_key(np.uint64(row_slots[row]), keys, slot_rows, row_slots)
            rows[row, FREQUENCY] = 0
            free[free_count] = row
            free_count += 1
        row += 1
    return row, free_count
