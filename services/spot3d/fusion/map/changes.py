"""Changes of the 3D heatmap since a client's last query, so that dashboards need not fetch the whole map."""

import time

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.map.map_arrays import FIRST, FREQUENCY, HEAT
from spot3d.kernel import kernel

_TOLERANCE = 12
"""Heat that changes by no more than this, 255ths, looks the same: 5 %."""


class ChangeLog:
    """Numbers each change of a map point that is worth sending; clients say up to which number they have them.

    A change: a point begins or ceases to count, its row is reused for another point, its heat changes by 5 %, or it was
    seen twice as often as when last sent. So a point is sent a few times, not with every frame. generation: of the map;
    changes of another one are void. Nothing is recorded until a client asks.
    """

    def __init__(self, limit: int) -> None:
        """limit: of the map's points."""
        self._limit = limit
        self.generation = 0
        self.clear()

    def clear(self) -> None:
        """Start another generation, as the map has been emptied."""
        self.generation = max(time.time_ns(), self.generation + 1)
        self.last = 0
        # Untouched pages cost no memory.
        self._change, self._frequency = np.zeros(self._limit, np.int64), np.zeros(self._limit, np.float32)
        self._heat, self._first = np.zeros(self._limit, np.uint8), np.zeros(self._limit, np.float32)

    def after(
        self, since: int, most: int, rows: NDArray[np.float32], least: float, tau: float
    ) -> tuple[NDArray[np.int64], int, int]:
        """The rows that changed after change number `since`, at most `most` >= 1, in the order of their changes.

        rows: (n, 16) float32 map rows; least, tau: as in `frequent_points`. Returns row numbers (k,), the number of the
        last change among them, and how many rows are left for the next call.
        """
        sent = self._change, self._frequency, self._heat, self._first
        self.last = int(_number_changes(rows, np.float32(least), np.float32(tau), *sent, self.last))
        change = self._change[: len(rows)]
        chosen = np.flatnonzero(change > since)
        behind = max(0, len(chosen) - most)
        if behind:
            chosen = chosen[np.argpartition(change[chosen], most)[:most]]
        chosen = chosen[np.argsort(change[chosen])]
        cursor = int(change[chosen[-1]]) if len(chosen) else self.last
        return chosen, cursor, behind

    def as_sent(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint32]]:
        """Heat in 255ths and frequency (0: the point does not count) of rows, as of their last change."""
        return self._heat[rows], self._frequency[rows].astype(np.uint32)


@kernel("i8(f4[:,::1], f4, f4, i8[::1], f4[::1], u1[::1], f4[::1], i8)")
def _number_changes(
    rows: NDArray[np.float32],
    least: np.float32,
    tau: np.float32,
    change: NDArray[np.int64],
    sent_frequency: NDArray[np.float32],
    sent_heat: NDArray[np.uint8],
    sent_first: NDArray[np.float32],
    last: int,
) -> int:
    """Give each changed row the next number, and record its values as sent; returns the last number."""
    for row in range(len(rows)):
        now, before = rows[row, FREQUENCY], sent_frequency[row]
        if now < least:
            now = np.float32(0)
        if now == 0 and before == 0:
            continue
        heat = np.float32(0)
        if now > 0:
            heat = np.float32(255) * (rows[row, HEAT] / (now + tau))
        same = before > 0 and before <= now < 2 * before and rows[row, FIRST] == sent_first[row]
        if same and abs(heat - np.float32(sent_heat[row])) <= np.float32(_TOLERANCE):
            continue
        last += 1
        change[row], sent_frequency[row], sent_heat[row] = last, now, np.uint8(heat + np.float32(0.5))
        sent_first[row] = rows[row, FIRST]
    return last
