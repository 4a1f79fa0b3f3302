"""Sums the counters of a stage's successive processes: one that is restarted counts from zero."""

from collections import Counter

from spot3d.run.report import StageReport
from spot3d_schemas import Health


class HealthTotals:
    """Sums over one stage's processes. latest: the last health message of the current one."""

    def __init__(self, first: Health) -> None:
        self.latest = first
        # Of earlier processes.
        self._drops: Counter[str] = Counter()
        self._events: Counter[str] = Counter()
        self._cpu_s, self._errors, self._last_error = 0.0, 0, ""
        self._step_ms: dict[str, float | None] = {}

    def add(self, said: Health) -> None:
        """Take in the stage's next health message."""
        last, self.latest = self.latest, said
        if said.pid == last.pid:
            return
        self._step_ms = self._times(last)
        self._drops.update(last.drops)
        self._events.update(last.events)
        self._cpu_s += last.cpu_s
        self._errors += last.errors
        self._last_error = last.last_error or self._last_error

    def drops(self) -> dict[str, int]:
        """Messages that were not processed, by reason."""
        return dict(self._drops + Counter(self.latest.drops))

    def report(self, restarts: int) -> StageReport:
        """The stage's part of the run's report.

        Memory is that of the current process, times of a step are those of the last one that made any.
        """
        latest = self.latest
        return StageReport(
            restarts=restarts,
            step_ms=self._times(latest),
            cpu_s=self._cpu_s + latest.cpu_s,
            rss_mb=latest.rss_bytes / 2**20,
            errors=self._errors + latest.errors,
            last_error=latest.last_error or self._last_error,
            events=dict(self._events + Counter(latest.events)),
        )

    def _times(self, said: Health) -> dict[str, float | None]:
        return self._step_ms if said.step_ms_p50 is None else {"p50": said.step_ms_p50, "p99": said.step_ms_p99}
