"""What fails on a frame while the work goes on: counted and logged stage by stage, as a stage's own process does."""

import logging
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from spot3d.dataflow.rate_limited_log import RateLimitedLog

log = logging.getLogger(__name__)


class StageFailedError(Exception):
    """A stage failed on frames of a run whose results must lack nothing."""


class Failures:
    """errors: how many there were of each stage; last_error: what the last one of each was."""

    def __init__(self) -> None:
        self.errors: Counter[str] = Counter()
        self.last_error: dict[str, str] = {}
        self._log = RateLimitedLog(log)

    def add(self, stage: str, text: str, error: Exception) -> str:
        """Count and log an exception, with its traceback the first time; returns what it says."""
        kind = type(error).__name__
        self.errors[stage] += 1
        self.last_error[stage] = f"{text}: {kind}: {error}"
        self._log.say(f"{stage} {kind}", self.last_error[stage], time.monotonic(), error)
        return f"{kind}: {error}"

    @contextmanager
    def of(self, stage: str, text: str) -> Iterator[None]:
        """Add an exception that ends the block, and go on behind it."""
        try:
            yield
        except Exception as error:
            self.add(stage, text, error)

    def refuse(self) -> None:
        """Raise StageFailedError with which stages failed, how often and what the last error was, unless none did."""
        if self.errors:
            said = [f"{count} of {stage}, the last: {self.last_error[stage]}" for stage, count in self.errors.items()]
            raise StageFailedError(f"a run with failures is not measured: {'; '.join(said)}")
