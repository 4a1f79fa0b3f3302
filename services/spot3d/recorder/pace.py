"""When a recorded message is due, at a multiple of the recorded pace, with pauses."""

import threading
import time

_BEHIND_S = 0.5
"""A replay that is later than this goes on from now and does not catch up in a burst."""


class Pace:
    """The clock of a replay. Any thread may pause it. rate: recorded seconds per second."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._changed = threading.Condition()
        self._start_s = time.monotonic()
        self._paused_s: float | None = None

    @property
    def paused(self) -> bool:
        """Whether the clock stands still."""
        return self._paused_s is not None

    def restart(self) -> None:
        """Start the recording's time from now."""
        with self._changed:
            self._start_s = time.monotonic()
            self._paused_s = None if self._paused_s is None else self._start_s

    def toggle(self) -> None:
        """Pause, or resume from there."""
        with self._changed:
            now_s = time.monotonic()
            if self._paused_s is None:
                self._paused_s = now_s
            else:
                self._start_s += now_s - self._paused_s
                self._paused_s = None
            self._changed.notify_all()

    def wait(self, recorded_s: float, stop: threading.Event) -> bool:
        """Wait until this time of the recording. Returns whether it was reached before `stop` was set."""
        with self._changed:
            while not stop.is_set():
                if self._paused_s is None:
                    late_s = time.monotonic() - self._start_s - recorded_s / self._rate
                    if late_s >= 0:
                        self._start_s += late_s if late_s > _BEHIND_S else 0
                        return True
                    self._changed.wait(min(-late_s, 0.1))
                else:
                    self._changed.wait(0.1)
        return False
