"""One producer per topic: as long as it is there, messages of others are refused, counted and reported."""

import threading
from dataclasses import dataclass

from spot3d.dataflow.alive import Alive
from spot3d_schemas import TOPICS

_HOLD_S = 0.5
"""A producer without a liveliness token counts as there for this long after its last message, unless one with a token
comes."""
_NAMED_S = 10.0
"""A second producer is reported for this long after its last message."""


@dataclass(slots=True)
class _Holder:
    sender: str | None
    heard_s: float
    has_token: bool


class Producers:
    """The producer of each topic; any thread may ask. Times are monotonic seconds."""

    def __init__(self, alive: Alive) -> None:
        self._alive = alive
        self._holders: dict[str, _Holder] = {}
        self._rivals: dict[str, float] = {}
        self._lock = threading.Lock()

    def admit(self, topic: str, sender: str | None, now_s: float) -> bool:
        """Whether to accept a message of this sender: the first one keeps the topic until it is gone."""
        present = self._alive.processes(TOPICS[topic].producer)
        with self._lock:
            holder = self._holders.get(topic)
            if holder is not None and holder.sender != sender:
                there = holder.sender in present
                gone = holder.has_token or sender in present or now_s - holder.heard_s >= _HOLD_S
                if there or not gone:
                    self._rivals[topic] = now_s
                    return False
                holder = None
            if holder is None:
                holder = self._holders[topic] = _Holder(sender, now_s, False)
            holder.heard_s = now_s
            holder.has_token |= sender in present
            return True

    def contested(self, now_s: float) -> list[str]:
        """The topics that a second producer has published recently."""
        with self._lock:
            return sorted(topic for topic, heard_s in self._rivals.items() if now_s - heard_s < _NAMED_S)
