"""The 3D heatmap H_3D: points with colour, heat and frequency, found again by voxel (paper, Sec. V-A)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.map.map_arrays import COLUMNS, FREQUENCY, HEAT, LAST, MapArrays, remove_key
from spot3d.kernel import kernel
from spot3d.voxel_hash import EMPTY, empty_table, find_slot

_EVICTED_SHARE = 0.2
"""Share of the points, the least useful, from among which points are evicted."""
_SAMPLE = 2000
"""About as many points are sampled to find the limit of that share."""


class Heatmap3D:
    """Bounded point map with a voxel hash; `arrays` holds all of it."""

    def __init__(self, limit: int, voxel: float) -> None:
        self.limit = limit
        self.voxel = voxel
        # Untouched pages of these arrays cost no memory, so the map pays only for the points it holds.
        rows, keys = np.empty((limit, COLUMNS), np.float32), empty_table(limit)
        self.arrays = MapArrays(
            rows=rows,
            numbers=rows.view(np.int32),  # single precision counts to 2^24 frames only
            keys=keys,
            slot_rows=np.empty(len(keys), np.int32),
            row_slots=np.empty(limit, np.int32),
            free=np.empty(limit, np.int32),
            counts=np.zeros(2, np.int64),
        )
        self.evicted = self._looked_at = 0

    @property
    def used(self) -> int:
        """How many rows have held points."""
        return int(self.arrays.counts[0])

    @property
    def free_count(self) -> int:
        """How many of these rows are free."""
        return int(self.arrays.counts[1])

    @property
    def count(self) -> int:
        """How many points there are."""
        return self.used - self.free_count

    def points(self) -> NDArray[np.float32]:
        """View of the rows that have held points, (used, 16) float32; those of frequency 0 are free."""
        return self.arrays.rows[: self.used]

    def last_seen(self) -> NDArray[np.int32]:
        """View of the number of the frame that last saw each of these points, (used,) int32."""
        return self.arrays.numbers[: self.used, LAST]

    def clear(self) -> None:
        """Forget every point."""
        self.evicted = self._looked_at = 0
        self.arrays.counts.fill(0)
        self.arrays.keys.fill(EMPTY)

    def held(self) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """`points`, and each one's voxel key, (n,) int64, -1 = none; copied as simply as possible, as frames wait."""
        points = self.points()
        slots = self.arrays.row_slots[: len(points)]
        return points.copy(), np.where(slots >= 0, self.arrays.keys[slots], EMPTY)

    def restore(self, rows: NDArray[np.float32], keys: NDArray[np.int64]) -> None:
        """Restore the map of which `held` returned this, without its free rows; at most `limit` points."""
        self.clear()
        self.arrays.counts[0] = len(rows)
        self.points()[:] = rows
        _enter(self.arrays, keys)

    def evict(self, wanted: int, tau: float) -> int:
        """Free the rows of `wanted` of the least useful points, or of a fifth of all; returns how many.

        Usefulness: the pseudo-average confidence, c / (f + tau), plus the number of the last frame that saw the point
        as a share of all frames, so that what the camera looks at now stays. The next call continues where this one
        ends: no frame waits for more than it needs itself.
        """
        step = max(1, self.used // _SAMPLE)
        sample, last = self.points()[::step], self.last_seen()[::step].astype(np.float32)
        held = sample[:, FREQUENCY] > 0
        sample, last = sample[held], last[held]
        if len(sample) == 0:
            return 0
        latest = np.float32(max(1.0, float(last.max())))
        useful = sample[:, HEAT] / (sample[:, FREQUENCY] + np.float32(tau)) + last / latest
        before = self.free_count
        wanted = min(wanted, int(_EVICTED_SHARE * self.count))
        least = np.float32(np.quantile(useful, _EVICTED_SHARE))
        self._looked_at = _evict(self.arrays, self._looked_at, wanted, least, latest, np.float32(tau))
        self.evicted += self.free_count - before
        return self.free_count - before


@kernel()
def _enter(known: MapArrays, wanted: NDArray[np.int64]) -> None:
    """Insert the first rows' keys into the empty table; a row without a key gets the slot -1."""
    for row in range(len(wanted)):
        known.row_slots[row] = -1
        if wanted[row] == EMPTY:
            continue
        slot = find_slot(known.keys, wanted[row])
        if known.keys[slot] == EMPTY:
            known.keys[slot], known.slot_rows[slot], known.row_slots[row] = wanted[row], row, slot


@kernel()
def _evict(known: MapArrays, begin: int, wanted: int, least: np.float32, latest: np.float32, tau: np.float32) -> int:
    """Free rows no more useful than `least`, from row `begin` on and around, until `wanted` are freed (see `evict`).

    Returns the row after the last one looked at.
    """
    rows, used, free_count = known.rows, known.counts[0], known.counts[1]
    row, full = begin, free_count + wanted
    for _ in range(used):
        if free_count >= full:
            break
        row = row if row < used else 0
        frequency = rows[row, FREQUENCY]
        useful = rows[row, HEAT] / (frequency + tau) + np.float32(known.numbers[row, LAST]) / latest
        if frequency > 0 and useful <= least:
            if known.row_slots[row] >= 0:
                remove_key(np.uint64(known.row_slots[row]), known.keys, known.slot_rows, known.row_slots)
            rows[row, FREQUENCY] = 0
            known.free[free_count] = row
            free_count += 1
        row += 1
    known.counts[1] = free_count
    return row
