"""A stage's counters, and the health message that is made from them."""

import os
import threading
from collections import Counter, deque

import numpy as np

from spot3d.dataflow.process_use import ProcessUse
from spot3d_schemas import Header, Health
from spot3d_schemas.limits import MAX_COUNT

_REMEMBERED = 300
"""Latencies and step times that the percentiles are taken over: the last ten seconds of a camera."""


class Counters:
    """Counts of one stage's process; any thread may add to them. Times are monotonic seconds."""

    def __init__(self, stage: str, now_s: float) -> None:
        self._stage = stage
        self._started_s = self._asked_s = now_s
        self._received = self._published = self._errors = self._steps = 0
        self._last_error = ""
        self._drops: Counter[str] = Counter()
        self._events: Counter[str] = Counter()
        self._sent: Counter[str] = Counter()
        self._sent_bytes: Counter[str] = Counter()
        self._latencies_ms: deque[float] = deque(maxlen=_REMEMBERED)
        self._steps_ms: deque[float] = deque(maxlen=_REMEMBERED)
        self._lock = threading.Lock()

    def received(self) -> None:
        """Count a valid message."""
        with self._lock:
            self._received += 1

    def published(self, topic: str, size: int) -> None:
        """Count a sent message of `size` bytes."""
        with self._lock:
            self._published += 1
            self._sent[topic] += 1
            self._sent_bytes[topic] += size

    def drop(self, reason: str, count: int = 1) -> None:
        """Count messages that are not processed."""
        if count:
            with self._lock:
                # Forged sequence numbers can make more messages seem lost than a message can state.
                self._drops[reason] = min(self._drops[reason] + count, MAX_COUNT)

    def event(self, kind: str, count: int = 1) -> None:
        """Count events of a kind that lost no message."""
        with self._lock:
            self._events[kind] += count

    def error(self, text: str) -> None:
        """Count a refused message or a failed step."""
        with self._lock:
            self._errors += 1
            self._last_error = text

    def step(self, seconds: float) -> None:
        """Record the time the core took for a frame."""
        with self._lock:
            self._steps += 1
            self._steps_ms.append(1e3 * seconds)

    def latency(self, nanoseconds: int | None) -> None:
        """Record the time from the source's publishing to this stage's own, by wall clock; None: the clocks differ."""
        with self._lock:
            if nanoseconds is None:
                self._latencies_ms.clear()
            else:
                self._latencies_ms.append(1e-6 * nanoseconds)

    def health(self, header: Header, now_s: float, use: ProcessUse, state: str = "") -> Health:
        """The health message. Its rate counts the steps since the last call. state: what is wrong now."""
        with self._lock:
            elapsed_s, steps = now_s - self._asked_s, self._steps
            self._asked_s, self._steps = now_s, 0
            latency, step = _percentiles(self._latencies_ms), _percentiles(self._steps_ms)
            return Health(
                header=header,
                stage=self._stage,
                pid=os.getpid(),
                uptime_s=max(0.0, now_s - self._started_s),
                received=self._received,
                published=self._published,
                drops=dict(self._drops),
                events=dict(self._events),
                errors=self._errors,
                last_error=self._last_error,
                rate_hz=steps / elapsed_s if elapsed_s > 0 else None,
                latency_ms_p50=latency[0],
                latency_ms_p99=latency[1],
                step_ms_p50=step[0],
                step_ms_p99=step[1],
                cpu_s=use.cpu_s,
                rss_bytes=use.rss_bytes,
                threads=use.threads,
                sent=dict(self._sent),
                sent_bytes=dict(self._sent_bytes),
                state=state,
            )


def _percentiles(values: deque[float]) -> tuple[float, float] | tuple[None, None]:
    if not values:
        return None, None
    p50, p99 = np.percentile(values, (50, 99))
    return float(p50), float(p99)
