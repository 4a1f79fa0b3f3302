"""Tracks the stream of captures that a stage is in: the source's latest, not an earlier one."""

from collections import deque
from typing import Literal
from uuid import uuid4

_PAST = 16
"""Number of earlier streams that are recognised."""
_SILENT_S = 5.0
"""An earlier stream is followed again if nothing has come of the current one for this long."""


def new_stream() -> str:
    """A unique name for a stream."""
    return uuid4().hex[:16]


class Streams:
    """The stream that a stage's inputs are in. Times are monotonic seconds."""

    def __init__(self) -> None:
        self.current: str | None = None
        self._heard_s = 0.0
        self._past: deque[str] = deque(maxlen=_PAST)

    def judge(self, stream: str | None, now_s: float) -> Literal["same", "begins", "earlier"]:
        """Classify a message's stream: the current one, a new one that begins with this message, or an earlier one.

        A message that names no stream counts as one of the current stream.
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
