"""Detects stamps of a camera's frames that advance more slowly than time: in another unit, or of no clock."""

import threading
from collections import deque

from spot3d.dataflow.order import RESTART_NS
from spot3d_schemas import Header

_JUDGED, _ENOUGH = 100, 20
"""Number of frames that are looked at, and how many there must be."""
_SPAN_S = 2.0
"""Least time span of the frames: queued frames arrive all at once."""
_SLOW = 200.0
"""Slowdown that is reported: microseconds taken for nanoseconds are 1000 times slower; no recording is played so
slowly."""
_RECENT_S = 10.0
"""There is no warning if no frame has come for this long."""


class StampPace:
    """The stamps of the latest captures and their arrival times, monotonic seconds; any thread may ask."""

    def __init__(self) -> None:
        self._heard: deque[tuple[float, int]] = deque(maxlen=_JUDGED)
        self._stream: str | None = None
        self._lock = threading.Lock()

    def observe(self, header: Header, now_s: float) -> None:
        """Record a frame, whether or not it is refused."""
        with self._lock:
            back = bool(self._heard) and header.stamp_ns <= self._heard[-1][1] - RESTART_NS
            if header.stream != self._stream or back:
                self._heard.clear()
            self._stream = header.stream
            self._heard.append((now_s, header.stamp_ns))

    def notice(self, now_s: float) -> str:
        """A warning about the stamps, and what to do; empty if nothing is wrong or too few frames have come."""
        with self._lock:
            if len(self._heard) < _ENOUGH or now_s - self._heard[-1][0] > _RECENT_S:
                return ""
            (first_s, first_ns), (last_s, last_ns) = self._heard[0], self._heard[-1]
        span_s, stamped_s = last_s - first_s, 1e-9 * (last_ns - first_ns)
        if span_s < _SPAN_S or _SLOW * stamped_s > span_s:
            return ""
        if stamped_s <= 0:
            return "the timestamps of frames do not advance: set stamp_ns to each frame's time of capture"
        slower = f"about {float(f'{span_s / stamped_s:.1g}'):,.0f} times too slowly"
        return (
            f"the timestamps of frames advance {slower}: give stamp_ns in nanoseconds (a microsecond is 1000 of them)"
        )
