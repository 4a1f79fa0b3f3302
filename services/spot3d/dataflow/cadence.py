"""Decides when the objects are updated: by capture time, so that every way to run gives the same updates."""


class Cadence:
    """Says after which fused frames the objects are computed.

    The first fused frame starts the interval. A frame is due if it was captured at least `interval_s` after the last
    update (or that start). A stamp that goes back restarts the interval: another recording begins.
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
        """Make the very next frame due again, because the update that was due could not be made."""
        self._since_ns = self._last_ns - self._interval_ns

    def reset(self) -> None:
        """Start over: the next fused frame is the first one."""
        self._since_ns = None
