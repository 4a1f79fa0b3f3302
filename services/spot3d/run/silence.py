"""Notices a stage that hangs: its process runs, and yet nothing is heard of it any more."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from spot3d_schemas import Health

SILENT_S = 20.0
"""A stage whose health is this late hangs.

A thread of its own publishes it, which neither compiling holds up nor a core that takes less than `STUCK_S` for a
frame. A stage that hangs holds up the others as well, until Zenoh closes its full connection after five seconds; a
machine that swaps may take a few times as long.
"""
START_S = 900.0
"""A stage that has said nothing for this long since its start hangs.

Before it is on line it may compile its kernels: all stages at once in a minute on two cores. A source waits three
minutes for them; no device is five times slower than that. A source itself may read its whole input first.
"""
_LOOK_S = 0.5
"""Longest time between two looks that counts: after more the run itself has stood still, and so has what it hears."""


@dataclass(frozen=True, slots=True)
class _Sign:
    """The last sign of life of a process: its health message, or that it was started. at_s: time awake."""

    pid: int
    health: Health | None
    at_s: float


class Silence:
    """For how long each stage has said nothing, in time that this process was awake.

    health_interval_s: time between two health messages of a stage. Times are monotonic seconds.
    """

    def __init__(self, health_interval_s: float) -> None:
        self._interval_s = health_interval_s
        self._awake_s = 0.0
        self._looked_s: float | None = None
        self._signs: dict[str, _Sign] = {}

    def look(self, latest: Mapping[str, Health], processes: Mapping[str, int], now_s: float) -> list[str]:
        """The stages that hang; call it several times a second.

        latest: the last health message of each stage. processes: the process ids of those that run.
        """
        if self._looked_s is not None:
            self._awake_s += min(now_s - self._looked_s, _LOOK_S)
        self._looked_s = now_s
        before, self._signs = self._signs, {}
        for stage, pid in processes.items():
            health = latest.get(stage)
            if health is not None and health.pid != pid:
                health = None  # of the process before
            sign = before.get(stage)
            if sign is None or sign.pid != pid or sign.health is not health:
                sign = _Sign(pid, health, self._awake_s)
            self._signs[stage] = sign
        return [
            stage
            for stage, sign in self._signs.items()
            if self._awake_s - sign.at_s > self._interval_s + self.limit_s(stage)
        ]

    def limit_s(self, stage: str) -> float:
        """For how long, besides the interval of its health messages, a stage that runs may say nothing now."""
        if self._signs[stage].health is not None:
            return SILENT_S
        return inf if stage == "source" else START_S
