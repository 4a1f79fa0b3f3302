"""The queues in which a stage's inputs wait for its one working thread."""

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Tray:
    """Queue size of one input, and whether a full queue drops its oldest item or makes the sender wait."""

    size: int
    keeps_newest: bool


class Inbox:
    """Bounded queues, one per input, read in order of arrival."""

    def __init__(self, trays: dict[str, Tray]) -> None:
        self._trays = trays
        self._waiting: dict[str, deque[tuple[int, Any]]] = {name: deque() for name in trays}
        self._arrivals = 0
        self._closed = False
        self._changed = threading.Condition()

    def put(self, name: str, item: Any) -> int:
        """Add an item; returns how many older ones it pushed out. After `close` items are dropped."""
        tray, queue = self._trays[name], self._waiting[name]
        with self._changed:
            pushed_out = 0
            if tray.keeps_newest:
                while len(queue) >= tray.size:
                    queue.popleft()
                    pushed_out += 1
            else:
                self._changed.wait_for(lambda: len(queue) < tray.size or self._closed)
            if not self._closed:
                self._arrivals += 1
                queue.append((self._arrivals, item))
                self._changed.notify_all()
            return pushed_out

    def offer(self, name: str, item: Any) -> bool:
        """Add an item if there is room for it; returns whether there was."""
        with self._changed:
            if self._closed or len(self._waiting[name]) >= self._trays[name].size:
                return False
            self._arrivals += 1
            self._waiting[name].append((self._arrivals, item))
            self._changed.notify_all()
            return True

    @property
    def waiting(self) -> bool:
        """Whether there is anything to read."""
        with self._changed:
            return any(self._waiting.values())

    def get(self, timeout_s: float) -> tuple[str, Any] | None:
        """The oldest item with the name of its input; None where nothing came in time."""
        with self._changed:
            self._changed.wait_for(lambda: any(self._waiting.values()), timeout_s)
            name = min(
                (name for name, queue in self._waiting.items() if queue),
                key=lambda name: self._waiting[name][0][0],
                default=None,
            )
            if name is None:
                return None
            item = self._waiting[name].popleft()[1]
            self._changed.notify_all()
            return name, item

    def close(self) -> None:
        """Release everybody who waits to add an item."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
