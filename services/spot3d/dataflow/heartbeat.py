"""A file that says that a process still turns, for a supervisor beside it that cannot listen to the dataflow."""

import logging
import os
import time
from contextlib import suppress
from pathlib import Path

log = logging.getLogger(__name__)

STUCK_S = 20.0
"""A process whose loop has not turned for so long beats no more."""
_INTERVAL_S = 1.0


class Heartbeat:
    """Writes the seconds since the machine's start, as /proc/uptime counts them, and its process id into a file.

    That clock cannot be set, as the time of day can. path: the file; None: nothing is written. Any thread may beat.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._beaten_s = float("-inf")
        self._told = False

    def beat(self) -> None:
        """The process turns; written once a second at most. What cannot be written is told once and ends nothing."""
        now_s = time.monotonic()
        if self._path is None or now_s - self._beaten_s < _INTERVAL_S:
            return
        self._beaten_s = now_s
        partial = self._path.with_name(f"{self._path.name}.partial")
        try:
            partial.write_text(f"{int(time.clock_gettime(time.CLOCK_BOOTTIME))} {os.getpid()}\n")
            partial.replace(self._path)
        except OSError as error:
            # A disk that is full for a moment is none for ever.
            if not self._told:
                log.warning("no heartbeat in %s: %s", self._path, error.strerror)
            self._told = True

    def close(self) -> None:
        """The process ends as it should: nobody is to take its last beat for that of a process that hangs."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
