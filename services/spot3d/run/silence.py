"""Notices a stage that hangs: its process runs, and yet nothing is heard of it any more."""

from collections.abc import Mapping

from spot3d_schemas import Health

SILENT_S = 20.0
"""A stage whose health is this late hangs.

A thread of its own publishes it, which neither compiling holds up nor a core that takes less than `STUCK_S` for a
frame. A stage that hangs holds up the others as well, until Zenoh closes its full connection after five seconds; a
machine that swaps may take a few times as long.
"""
_LOOK_S = 0.5
"""Longest time between two looks that counts: after more the run itself has stood still, and so has what it hears."""


class Silence:
    """For how long each stage has said nothing, in time that this process was awake.

    health_interval_s: time between two health messages of a stage. Times are monotonic seconds.
    """

    def __init__(self, health_interval_s: float) -> None:
        self._limit_s = health_interval_s + SILENT_S
        self._awake_s = 0.0
        self._looked_s: float | None = None
        self._heard: dict[str, tuple[Health, float]] = {}

    def look(self, latest: Mapping[str, Health], processes: Mapping[str, int], now_s: float) -> list[str]:
        """The stages that hang; call it several times a second.

        latest: the last health message of each stage. processes: the process ids of those that run. A process that has
        said nothing yet does not hang: it may compile its kernels for minutes before it is on line.
        """
        if self._looked_s is not None:
            self._awake_s += min(now_s - self._looked_s, _LOOK_S)
        self._looked_s = now_s
        before = self._heard
        self._heard = {}
        for stage, health in latest.items():
            if health.pid == processes.get(stage):
                same = stage in before and before[stage][0] is health
                self._heard[stage] = before[stage] if same else (health, self._awake_s)
        return [stage for stage, (_, heard_s) in self._heard.items() if self._awake_s - heard_s > self._limit_s]
