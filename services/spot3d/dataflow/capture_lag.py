"""Detects that a camera's frames are sent later and later: the program that reads the camera is slow or queues them.

Lags that are measured from the time of sending cannot show it.
"""

import threading
from collections import deque

from spot3d_schemas import Header

_JUDGED, _SPAN_S = 200, 2.0
"""Frames that are kept, and the seconds over which the minimum lag is taken: a single stall is caught up in them."""
_LAG_S = 0.5
_SAME_CLOCK_S = 60.0
"""Stamps farther than this from the time of sending are no wall clock's, or a recording's."""
_DRIFT = 2e-4
"""Maximum drift between two clocks, s/s: a camera's own clock is not set."""
_RECENT_S = 10.0
"""There is no warning if no frame has come for this long."""


class CaptureLag:
    """Lags from capture to sending of a stream's frames, by the sender's wall clock; any thread may ask."""

    def __init__(self) -> None:
        self._lags: deque[tuple[float, float]] = deque(maxlen=_JUDGED)
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
        if not lags or now_s - lags[-1][0] > _RECENT_S or lags[-1][0] - lags[0][0] < _SPAN_S:
            return ""
        latest_s = min(lag_s for at_s, lag_s in lags if lags[-1][0] - at_s <= _SPAN_S)
        if abs(least_s) > _SAME_CLOCK_S or latest_s - least_s < _LAG_S:
            return ""
        later = f"the delay from capture to sending has grown by {latest_s - least_s:.1f} s"
        return (
            f"{later}: the program that reads the camera is too slow, or queues frames; let it send only the newest one"
        )
