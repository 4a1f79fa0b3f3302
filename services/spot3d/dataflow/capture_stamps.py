"""Detects wrong stamps of a camera's frames, and frames that are sent later and later."""

import threading
from collections import deque

from spot3d.dataflow.order import RESTART_NS
from spot3d_schemas import Header

_RECENT_S = 10.0
"""There is no warning if no frame has come for this long."""
_STAMPS, _ENOUGH = 100, 20
"""Number of frames whose stamps are looked at, and how many there must be."""
_SPAN_S = 2.0
"""Least time span of these frames: queued frames arrive all at once."""
_SLOW = 200.0
"""Slowdown that is reported: microseconds taken for nanoseconds are 1000 times slower; no recording is played so
slowly."""
_DISTINCT = 0.4
"""Least share of different stamps: a program may send each frame twice."""
_LAGS, _LAG_SPAN_S = 200, 2.0
"""Frames whose lags are kept, and the seconds over which the minimum is taken: a single stall is caught up in them."""
_LAG_S = 0.5
_SAME_CLOCK_S = 60.0
"""Stamps farther than this from the time of sending are no wall clock's, or a recording's."""
_DRIFT = 2e-4
"""Maximum drift between two clocks, s/s: a camera's own clock is not set."""


class StampPace:
    """The stamps of the latest captures and their arrival times, monotonic seconds; any thread may ask.

    They advance more slowly than time if they are in another unit, or of no clock; rounded ones repeat.
    """

    def __init__(self) -> None:
        self._heard: deque[tuple[float, int]] = deque(maxlen=_STAMPS)
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
            count, distinct = len(self._heard), len({stamp_ns for _, stamp_ns in self._heard})
        span_s, stamped_s = last_s - first_s, 1e-9 * (last_ns - first_ns)
        if span_s < _SPAN_S:
            return ""
        if stamped_s <= 0 or distinct < _DISTINCT * count:
            return (
                f"the timestamps of frames do not advance from each to the next ({distinct} of {count} differ), and "
                "those that repeat are refused: set stamp_ns to each frame's time of capture, not rounded to seconds"
            )
        if _SLOW * stamped_s > span_s:
            return ""
        slower = f"about {float(f'{span_s / stamped_s:.1g}'):,.0f} times too slowly"
        return (
            f"the timestamps of frames advance {slower}: give stamp_ns in nanoseconds (a microsecond is 1000 of them)"
        )


class CaptureLag:
    """Lags from capture to sending of a stream's frames, by the sender's wall clock; any thread may ask.

    They grow if the program that reads the camera is slow or queues frames. Lags measured from sending do not show it.
    """

    def __init__(self) -> None:
        self._lags: deque[tuple[float, float]] = deque(maxlen=_LAGS)
        self._least_s = 0.0
        self._stream: str | None = None
        self._lock = threading.Lock()

    def observe(self, header: Header, now_s: float) -> None:
        """Record a frame that arrived at `now_s`, monotonic seconds; one without a trace is ignored."""
        if not header.trace:
            return
        lag_s = 1e-9 * (header.trace[0].sent_ns - header.stamp_ns)
        with self._lock:
            if self._lags and header.stream == self._stream:
                at_s, before_s = self._lags[-1]
                # A lag cannot grow faster than time passes: a clock was set.
                anew = lag_s - before_s > now_s - at_s + _LAG_S
                self._least_s = min(lag_s, self._least_s + _DRIFT * (now_s - at_s))
            else:
                anew = True
            if anew:
                self._lags.clear()
                self._least_s, self._stream = lag_s, header.stream
            self._lags.append((now_s, lag_s))

    def notice(self, now_s: float) -> str:
        """A warning that states how much the lag has grown, and what to do; empty if it has not."""
        with self._lock:
            lags, least_s = list(self._lags), self._least_s
        if not lags or now_s - lags[-1][0] > _RECENT_S or lags[-1][0] - lags[0][0] < _LAG_SPAN_S:
            return ""
        latest_s = min(lag_s for at_s, lag_s in lags if lags[-1][0] - at_s <= _LAG_SPAN_S)
        if abs(least_s) > _SAME_CLOCK_S or latest_s - least_s < _LAG_S:
            return ""
        later = f"the delay from capture to sending has grown by {latest_s - least_s:.1f} s"
        return (
            f"{later}: the program that reads the camera is too slow, or queues frames; let it send only the newest one"
        )
