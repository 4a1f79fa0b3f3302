"""A queue of messages to be written, bounded in bytes, so that a slow disk costs messages and never memory.

The messages' bytes are in memory that is shared with the writing process, which needs no further copy.
"""

import mmap
import os
import tempfile
import threading
import time
from collections import deque
from dataclasses import dataclass

from spot3d.recorder.ring import Ring

_LARGE_BYTES = 65536
"""A message of at least this size holds an image."""
_RESERVED_BYTES = 16 * 2**20
"""Room that images must leave free: for minutes of poses and objects, which are worth more."""


@dataclass(frozen=True, slots=True)
class Heard:
    """One received message: `size` bytes at offset `at` of the shared memory.

    log_ns: time of receipt (see `Backlog`); publish_ns: wall clock at sending. place: stamp and stream, if it is a
    frame.
    """

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    at: int
    size: int
    place: tuple[int, str] | None


class Backlog:
    """A queue of messages of at most `limit_bytes`. Any thread may add; a single reader takes and releases them.

    They are logged at the wall clock of its beginning plus the time since, so that log times keep the pace of the
    messages if the clock is set meanwhile.
    file: descriptor of the shared memory. Whoever passes it on to the other process closes it.
    """

    def __init__(self, limit_bytes: int) -> None:
        self.file = _memory_file(limit_bytes)
        self._memory = mmap.mmap(self.file, limit_bytes)
        self._limit = limit_bytes
        self._ring = Ring(limit_bytes)
        self._clock_ns = time.time_ns() - time.monotonic_ns()
        self._queue: deque[Heard] = deque()
        self._closed = False
        self._changed = threading.Condition()

    def put(
        self, topic: str, publish_ns: int, sequence: int, data: bytes, wait: bool, place: tuple[int, str] | None = None
    ) -> bool:
        """Add a message, logged at the current time. Returns whether there was room; `wait`: wait for room."""
        size = len(data)
        with self._changed:
            if wait:
                self._changed.wait_for(lambda: self._closed or self._fits(size))
            at = self._ring.take(size) if not self._closed and self._fits(size) else None
            if at is None:
                return False
            self._memory[at : at + size] = data
            log_ns = self._clock_ns + time.monotonic_ns()
            self._queue.append(Heard(topic, log_ns, publish_ns, sequence, at, size, place))
            self._changed.notify_all()
            return True

    def has_room(self, size: int) -> bool:
        """Whether a message of `size` bytes could be added now."""
        with self._changed:
            return not self._closed and self._fits(size)

    def _fits(self, size: int) -> bool:
        reserved = _RESERVED_BYTES if size >= _LARGE_BYTES else 0
        return self._ring.used + size + reserved <= self._limit and self._ring.place(size) is not None

    def get(self, timeout_s: float) -> Heard | None:
        """The oldest message, or None if none comes in time. Its bytes stay valid until `done`."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._queue), timeout_s)
            return self._queue.popleft() if self._queue else None

    def done(self) -> None:
        """Release the bytes of the oldest message that was taken."""
        with self._changed:
            self._ring.give_back()
            self._changed.notify_all()

    def close(self) -> None:
        """Refuse further messages and wake threads that wait for room. Queued messages can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


def _memory_file(size: int) -> int:
    """Descriptor of an unnamed file, in memory where the system supports it (Linux). Only the used part takes space."""
    if hasattr(os, "memfd_create"):
        file = os.memfd_create("spot3d backlog")
    else:
        with tempfile.TemporaryFile() as temporary:
            file = os.dup(temporary.fileno())
    os.ftruncate(file, size)
    return file
