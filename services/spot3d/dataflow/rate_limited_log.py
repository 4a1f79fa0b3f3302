"""Logs errors at a limited rate, however many there are."""

import logging
import threading
import traceback

_INTERVAL_S = 10.0
"""Minimum time between two lines for one reason."""
_REASONS = 64
"""Maximum number of distinct reasons: invalid messages can cause any number."""


def printable(text: str) -> str:
    """The text as one line; control characters, which would affect a terminal, are escaped."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


class RateLimitedLog:
    """Logs each reason at once, and then at most every ten seconds with the number of suppressed lines.

    The first line of a reason includes the exception's traceback, if there is one.
    """

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._said: dict[str, tuple[float, int]] = {}
        self._lock = threading.Lock()

    def say(self, reason: str, text: str, now_s: float, error: BaseException | None = None) -> bool:
        """Log `text` for `reason`; returns whether it was logged. now_s: monotonic seconds."""
        with self._lock:
            if reason not in self._said and len(self._said) >= _REASONS:
                reason = "many reasons"
            first = reason not in self._said
            last_s, silent = self._said.get(reason, (float("-inf"), 0))
            if now_s - last_s < _INTERVAL_S:
                self._said[reason] = (last_s, silent + 1)
                return False
            self._said[reason] = (now_s, 0)
        where = [] if error is None or not first else "".join(traceback.format_exception(error)).splitlines()
        said = printable(text) + (f" ({silent} more since the last one)" if silent else "")
        self._log.warning("%s", "\n".join((said, *map(printable, where))))
        return True
