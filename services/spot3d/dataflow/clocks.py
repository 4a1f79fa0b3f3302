"""Detects clocks that differ between devices, from the sending and receiving times of messages."""

import threading
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from spot3d_schemas import STAGES, Header, Hop

_LATEST_NS = 10_000_000_000
"""No message travels for so long: a link that is silent for 2 s is given up, and credit after 5 s."""
_EARLIEST_NS = -50_000_000
"""An arrival this long before the sending shows clocks further apart than `spot3d doctor` accepts."""
_JUDGED, _ENOUGH = 100, 10
"""Messages whose median travel time counts, and how many there must be: a late or forged one has no effect."""
_RECENT_S = 10.0
"""A stage that has sent nothing for this long is not reported."""
_UNITS = (("day", 86400.0), ("hour", 3600.0), ("minute", 60.0), ("second", 1.0))


def travel_times_ns(trace: Sequence[Hop]) -> list[int]:
    """The travel times from each stage's sending to the next one's receiving, by their wall clocks."""
    return [after.received_ns - before.sent_ns for before, after in pairwise(trace)]


def one_clock(trace: Sequence[Hop]) -> bool:
    """Whether the travel times of a trace are plausible; if not, the clocks differ and lags mean nothing."""
    return all(_EARLIEST_NS <= way_ns <= _LATEST_NS for way_ns in travel_times_ns(trace))


def spoken(seconds: float) -> str:
    """A time in words: about 1 hour, about 2.5 days, about 200 ms."""
    for unit, size in _UNITS:
        count = round(abs(seconds) / size, 1)
        if count >= 1:
            return f"about {count:g} {unit}{'s' * (count != 1)}"
    return f"about {1000 * abs(seconds):.0f} ms"


def offset_in_words(ahead_s: float, whose: str) -> str:
    """A clock's offset in words; `whose` names the other clock: about 2 hours ahead of this one."""
    return f"{spoken(ahead_s)} {'ahead of' if ahead_s > 0 else 'behind'} {whose}"


class Clocks:
    """Travel times of each stage's messages to this one, by both wall clocks; any thread may add. Monotonic seconds."""

    def __init__(self) -> None:
        self._travel_times_ns: dict[str, deque[int]] = {stage: deque(maxlen=_JUDGED) for stage in STAGES}
        self._heard_s: dict[str, float] = {}
        self._lock = threading.Lock()

    def observe(self, header: Header, received_ns: int, now_s: float) -> None:
        """Record a message that arrived at `received_ns`, wall clock."""
        if header.trace and (sender := header.trace[-1]).stage in self._travel_times_ns:
            with self._lock:
                self._travel_times_ns[sender.stage].append(received_ns - sender.sent_ns)
                self._heard_s[sender.stage] = now_s

    def notice(self, now_s: float) -> str:
        """A warning about the clock that differs most from this one's; empty if none clearly does."""
        with self._lock:
            recent = [stage for stage, heard_s in self._heard_s.items() if now_s - heard_s < _RECENT_S]
            travel_times_ns = {
                stage: median(ways) for stage in recent if len(ways := self._travel_times_ns[stage]) >= _ENOUGH
            }
        apart = {stage: way for stage, way in travel_times_ns.items() if not _EARLIEST_NS <= way <= _LATEST_NS}
        if not apart:
            return ""
        stage = max(apart, key=lambda name: abs(apart[name]))
        text = f"the clock of the device that runs {stage} is {offset_in_words(-1e-9 * apart[stage], 'this one')}"
        return f"{text}, so that latencies are meaningless: synchronise the clocks (spot3d doctor)"
