"""Failures on single frames of a run that goes on: counted and logged by stage, as each stage's own process does."""

import logging
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from spot3d.dataflow.rate_limited_log import RateLimitedLog

log = logging.getLogger(__name__)


class StageFailedError(Exception):
    """A stage failed on frames of a run whose results must be complete."""


class Failures:
    """Failures by stage. errors: their number; last_error: the text of the last one."""

    def __init__(self) -> None:
        self.errors: Counter[str] = Counter()
        self.last_error: dict[str, str] = {}
        self._log = RateLimitedLog(log)

    def add(self, stage: str, text: str, error: Exception) -> str:
        """Count and log an exception, with its traceback the first time; returns its type and message."""
        kind = type(error).__name__
        self.errors[stage] += 1
        self.last_error[stage] = f"{text}: {kind}: {error}"
        self._log.say(f"{stage} {kind}", self.last_error[stage], time.monotonic(), error)
        return f"{kind}: {error}"

    @contextmanager
    def of(self, stage: str, text: str) -> Iterator[None]:
        """Add an exception that ends the block, and suppress it."""
        try:
            yield
        except Exception as error:
            self.add(stage, text, error)

    def refuse(self) -> None:
        """Raise StageFailedError, with each failed stage's count and last error, unless none failed."""
        if self.errors:
            said = [
                f"{count} of {stage}, the last one: {self.last_error[stage]}" for stage, count in self.errors.items()
            ]
            raise StageFailedError(f"a run with failures cannot be measured: {'; '.join(said)}")
