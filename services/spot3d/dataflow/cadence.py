"""When the objects are due for an update: by capture time, so that a run gives the same however it is run."""


class Cadence:
    """Says after which fused frames the objects are computed.

    The first fused frame starts the interval; a frame at least `interval_s` of capture time after the last
    update (or that start) is due. A stamp that goes back starts anew: another recording begins.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_ns = round(interval_s * 1e9)
        self._since_ns: int | None = None
        self._last_ns = 0

    def due(self, stamp_ns: int) -> bool:
        """Whether the objects are due after the frame fused just now; if so, the next interval starts."""
        if self._since_ns is None or stamp_ns < self._last_ns:
            self._since_ns = stamp_ns
        self._last_ns = stamp_ns
        if stamp_ns - self._since_ns < self._interval_ns:
            return False
        self._since_ns = stamp_ns
        return True

    def postpone(self) -> None:
        """The update that was due could not be made: the very next frame is due again."""
        self._since_ns = self._last_ns - self._interval_ns

    def reset(self) -> None:
        """The next fused frame is the first one."""
        self._since_ns = None
