"""Where messages wait to be written: bounded in bytes, so that a slow disk costs messages and never memory."""

import threading
import time
from collections import deque
from dataclasses import dataclass

_LARGE_BYTES = 65536
"""A message that is at least so long holds an image."""
_RESERVED_BYTES = 16 * 2**20
"""Room where images do not wait: poses and objects of minutes, which are worth more."""


@dataclass(frozen=True, slots=True)
class Heard:
    """One message as it was on the wire. log_ns: when it came; publish_ns: when it was sent; wall clock."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class Backlog:
    """A queue of messages of at most `limit_bytes`; any thread may add, one takes."""

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._bytes = 0
        self._last_ns = 0
        self._queue: deque[Heard] = deque()
        self._closed = False
        self._changed = threading.Condition()

    def put(self, topic: str, publish_ns: int, sequence: int, data: bytes, wait: bool) -> bool:
        """Add a message, stamped with the time of now; returns whether there was room, or waits for it."""
        with self._changed:
            limit = self._most_before(len(data))
            if wait:
                self._changed.wait_for(lambda: self._bytes <= limit or self._closed)
            if self._closed or self._bytes > limit:
                return False
            # Log times ascend in the file even where the clock was set back.
            self._last_ns = max(time.time_ns(), self._last_ns)
            self._queue.append(Heard(topic, self._last_ns, publish_ns, sequence, data))
            self._bytes += len(data)
            self._changed.notify_all()
            return True

    def has_room(self, size: int) -> bool:
        """Whether a message of so many bytes could be added now."""
        with self._changed:
            return not self._closed and self._bytes <= self._most_before(size)

    def _most_before(self, size: int) -> int:
        """Most bytes that may be there already when a message of so many is added."""
        return self._limit - size - (_RESERVED_BYTES if size >= _LARGE_BYTES else 0)

    def get(self, timeout_s: float) -> Heard | None:
        """The oldest message; None where none came in time."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._queue), timeout_s)
            if not self._queue:
                return None
            item = self._queue.popleft()
            self._bytes -= len(item.data)
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Nothing is added any more; who waits for room is let go. What is there can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
