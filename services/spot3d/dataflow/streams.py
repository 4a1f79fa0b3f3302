"""Which stream of captures a stage is in: the source's latest, and never one before."""

from collections import deque
from typing import Literal
from uuid import uuid4

_PAST = 16
"""So many streams before are known again."""
_SILENT_S = 5.0
"""An earlier stream is followed again where nothing has come of the present one for so long."""


def new_stream() -> str:
    """A name for a stream that nobody else has."""
    return uuid4().hex[:16]


class Streams:
    """The stream that a stage's inputs are in. Times are monotonic seconds."""

    def __init__(self) -> None:
        self.current: str | None = None
        self._heard_s = 0.0
        self._past: deque[str] = deque(maxlen=_PAST)

    def judge(self, stream: str | None, now_s: float) -> Literal["same", "begins", "earlier"]:
        """Take note of a message's stream: whether it goes on, begins with this message, or has been left behind.

        A sender that names no stream is taken to be in the present one.
        """
        if stream is None or stream == self.current:
            self._heard_s = now_s
            return "same"
        if stream in self._past and now_s - self._heard_s < _SILENT_S:
            return "earlier"
        if self.current is not None:
            self._past.append(self.current)
        self.current, self._heard_s = stream, now_s
        return "begins"
