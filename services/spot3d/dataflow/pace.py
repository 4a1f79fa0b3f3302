"""The clock of a replay, at a multiple of the recorded pace, with pauses."""

import math
import threading
import time
from collections.abc import Callable

_BEHIND_S = 0.5
"""A replay that is later than this goes on from now and does not catch up in a burst."""
_GAP_S = 60.0
"""A longer gap between recorded times is not waited for: a clock was set (from 1970, by NTP), or nothing happened.
Time lapses, with some seconds between frames, keep their pace."""
_LOOK_S = 0.1
"""Longest interval between two checks of pause and stop."""


class Pace:
    """The clock of a replay. Any thread may pause it. rate: recorded seconds per second.

    note: is told when the replay is late or skips a gap, by a kind and a sentence.
    """

    def __init__(self, rate: float, note: Callable[[str, str], object]) -> None:
        self._rate, self._note = rate, note
        self._lock = threading.Lock()
        self._start_s, self._reached_s = time.monotonic(), 0.0
        self._paused_s: float | None = None

    @property
    def paused(self) -> bool:
        """Whether the clock stands still."""
        return self._paused_s is not None

    def restart(self) -> None:
        """Start the recording's time from now."""
        with self._lock:
            self._start_s, self._reached_s = time.monotonic(), 0.0
            self._paused_s = None if self._paused_s is None else self._start_s

    def toggle(self) -> None:
        """Pause, or resume from there."""
        with self._lock:
            now_s = time.monotonic()
            if self._paused_s is None:
                self._paused_s = now_s
            else:
                self._start_s += now_s - self._paused_s
                self._paused_s = None

    def wait(self, recorded_s: float, stop: threading.Event, rest: Callable[[float], object] | None = None) -> bool:
        """Wait until this time of the recording. Returns whether it was reached before `stop` was set.

        rest: sleeps for so many seconds, or until `stop` is set.
        """
        while not stop.is_set():
            left_s = self._left_s(recorded_s)
            if left_s <= 0:
                return True
            (rest or stop.wait)(min(left_s, _LOOK_S))
        return False

    def _left_s(self, recorded_s: float) -> float:
        """Seconds until this time of the recording is due: 0 if it is, infinite while paused."""
        with self._lock:
            if self._paused_s is not None:
                return math.inf
            left_s = self._start_s + recorded_s / self._rate - time.monotonic()
            gap_s = recorded_s - self._reached_s
            if left_s > 0 and gap_s <= _GAP_S:
                return left_s
            self._reached_s = recorded_s
            if -_BEHIND_S <= left_s <= 0:
                return 0.0
            self._start_s -= left_s
        if left_s > 0:
            self._note("gap", f"a gap of {gap_s:.0f} s in the recording is skipped")
        else:
            self._note("behind", f"playing is {-left_s:.1f} s late, and continues from here without catching up")
        return 0.0
