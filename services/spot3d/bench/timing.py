"""Timing of calls in alternation, and the memory of this process."""

import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spot3d.evaluate.table import Cell, Column, columns

MEASURED = (
    *columns("data", "size", "step", "ms", "p99 ms", "CPU ms", "reference", "reference ms"),
    Column("reference / ours", 1),
    Column("copy ms", 3),
)
"""Columns of tables whose rows come from `measured_row`."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Median and 99th percentile of wall time, and median CPU time of this process, milliseconds."""

    median_ms: float
    p99_ms: float
    cpu_ms: float


@dataclass(frozen=True, slots=True)
class Timed:
    """A call and its repeats in each round; with more than one it is called once before as a warm-up."""

    call: Callable[[], object]
    repeats: int


def alternate(calls: Sequence[Timed], rounds: int) -> list[Timing]:
    """Measure all calls in turn, round after round, so that other load on the machine affects all alike."""
    for timed in calls:
        if timed.repeats > 1:
            timed.call()
    wall: list[list[float]] = [[] for _ in calls]
    cpu: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        for number, timed in enumerate(calls):
            for _ in range(timed.repeats):
                start_cpu, start = time.process_time(), time.perf_counter()
                timed.call()
                wall[number].append(time.perf_counter() - start)
                cpu[number].append(time.process_time() - start_cpu)
    return [summary(times, used) for times, used in zip(wall, cpu, strict=True)]


def summary(wall_s: Sequence[float], cpu_s: Sequence[float]) -> Timing:
    """The timing of calls with these wall and CPU times, seconds."""
    median, p99 = np.percentile(wall_s, (50, 99))
    return Timing(1e3 * float(median), 1e3 * float(p99), 1e3 * float(np.median(cpu_s)))


def measured_row(
    data: str, size: str, step: str, ours: Timing, reference: str, theirs: Timing | None, copy: Timing
) -> tuple[Cell, ...]:
    """A row for `MEASURED`; theirs: None where the reference is not available."""
    ratio = None if theirs is None else theirs.median_ms / ours.median_ms
    theirs_ms = None if theirs is None else theirs.median_ms
    first = (data, size, step, ours.median_ms, ours.p99_ms, ours.cpu_ms)
    return *first, reference, theirs_ms, ratio, copy.median_ms


def peak_memory_mb() -> float:
    """Peak memory of this process, MB.

    Read from /proc where available, as `ru_maxrss` includes what the parent held when it started this process.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 1024
