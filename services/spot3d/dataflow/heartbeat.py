"""A file that shows that a process's loop still runs, for a supervisor that cannot listen to the dataflow."""

import logging
import os
import time
from contextlib import suppress
from pathlib import Path

log = logging.getLogger(__name__)

STUCK_S = 20.0
"""A process whose loop has stood still for this long writes no more heartbeats, and no more health messages."""
_INTERVAL_S = 1.0


class Heartbeat:
    """Writes the seconds since the machine's start, as /proc/uptime counts them, and the process id into a file.

    Unlike the time of day, that clock cannot be set. path: the file; None: nothing is written. Any thread may call it.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._beaten_s = float("-inf")
        self._told = False

    def beat(self) -> None:
        """Write that the loop runs, once a second at most. A failure is logged once and otherwise ignored."""
        now_s = time.monotonic()
        if self._path is None or now_s - self._beaten_s < _INTERVAL_S:
            return
        self._beaten_s = now_s
        partial = self._path.with_name(f"{self._path.name}.partial")
        try:
            partial.write_text(f"{int(time.clock_gettime(time.CLOCK_BOOTTIME))} {os.getpid()}\n")
            partial.replace(self._path)
        except OSError as error:
            # A full disk may be so for a moment only.
            if not self._told:
                log.warning("cannot write the heartbeat %s: %s", self._path, error.strerror)
            self._told = True

    def close(self) -> None:
        """Delete the file at a regular end, so that its last beat is not taken for that of a hanging process."""
        if self._path is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
