"""Memory, descriptors, threads and drops of long-running processes, and whether they grow."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Literal

from spot3d.drawing.charts import Line, line_chart
from spot3d.drawing.picture import Picture

_ROOM_MB, _ROOM_SHARE = 30.0, 0.15
"""Memory by which the last third may exceed the second: heaps vary, caches fill."""
_ROOM_COUNT = 4
"""The same for descriptors and threads, which grow where somebody connects."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Readings of one process at one time. dropped: frames it has dropped so far; fused: by fusion, so far."""

    process: str
    at_s: float
    memory_mb: float
    descriptors: int
    threads: int
    dropped: int
    fused: int


@dataclass(frozen=True, slots=True)
class Growth:
    """The median of one number in the second third of the time and in the last one."""

    process: str
    number: Literal["memory_mb", "descriptors", "threads"]
    before: float
    after: float

    @property
    def too_much(self) -> bool:
        """Whether the number grows more than is allowed."""
        room = _ROOM_MB + _ROOM_SHARE * self.before if self.number == "memory_mb" else _ROOM_COUNT
        return self.after - self.before > room

    def line(self) -> str:
        """The growth and the verdict as text."""
        verdict = "GROWS" if self.too_much else "flat"
        return f"{self.process:10} {self.number:12} {self.before:7.0f} -> {self.after:7.0f}  {verdict}"


def read_process(pid: int) -> tuple[float, int, int]:
    """Resident memory in MB, open descriptors and threads; zeros where the process is gone."""
    folder = Path("/proc") / str(pid)
    try:
        status = (folder / "status").read_text(encoding="ascii", errors="replace")
        fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
        descriptors = sum(1 for _ in (folder / "fd").iterdir())
        return int(fields["VmRSS"].split()[0]) / 1024, descriptors, int(fields["Threads"])
    except (OSError, KeyError):
        return 0.0, 0, 0


def growths(readings: Sequence[Reading]) -> list[Growth]:
    """Growth of each process's numbers from the second third to the last; empty with too few readings."""
    if not readings:
        return []
    end_s = readings[-1].at_s
    found = []
    for name in _names(readings):
        own = [reading for reading in readings if reading.process == name]
        second = [reading for reading in own if end_s / 3 <= reading.at_s < 2 * end_s / 3]
        last = [reading for reading in own if reading.at_s >= 2 * end_s / 3]
        if not second or not last:
            continue
        numbers: tuple[Literal["memory_mb", "descriptors", "threads"], ...] = ("memory_mb", "descriptors", "threads")
        for number in numbers:
            before, after = (median(getattr(reading, number) for reading in part) for part in (second, last))
            found.append(Growth(name, number, float(before), float(after)))
    return found


def minute_table(readings: Sequence[Reading]) -> list[str]:
    """One line per minute: memory of each process, frames fused in that minute, and drops of all stages together."""
    names = _names(readings)
    lines = ["minute  fused   drops  " + " ".join(f"{name[:9]:>9}" for name in names) + "   (MB)"]
    fused = dropped = 0
    for minute in range(int(readings[-1].at_s // 60) + 1 if readings else 0):
        there = [reading for reading in readings if minute * 60 <= reading.at_s < (minute + 1) * 60]
        last = {reading.process: reading for reading in there}
        if not last:
            continue
        now_fused = max(reading.fused for reading in last.values())
        now_dropped = sum(reading.dropped for reading in last.values())
        memory = " ".join(f"{last[name].memory_mb:9.0f}" if name in last else " " * 9 for name in names)
        lines.append(f"{minute + 1:6} {now_fused - fused:6} {now_dropped - dropped:7}  {memory}")
        fused, dropped = now_fused, now_dropped
    return lines


def charts(readings: Sequence[Reading]) -> dict[str, Picture]:
    """Memory, descriptors, threads and drops per minute against time, one line per process."""
    titles = {"memory_mb": ("Memory", "MB"), "descriptors": ("Descriptors", "open"), "threads": ("Threads", "running")}
    pictures = {}
    for number, (title, unit) in titles.items():
        lines = [
            Line(
                name, [(reading.at_s / 60, getattr(reading, number)) for reading in readings if reading.process == name]
            )
            for name in _names(readings)
        ]
        pictures[number] = line_chart(title, "minutes", unit, lines)
    pictures["drops"] = line_chart("Frames dropped a minute", "minutes", "a minute", _drops(readings))
    return pictures


def _drops(readings: Sequence[Reading]) -> list[Line]:
    lines = []
    for name in _names(readings):
        own = [reading for reading in readings if reading.process == name]
        points = [
            (later.at_s / 60, 60 * (later.dropped - earlier.dropped) / (later.at_s - earlier.at_s))
            for earlier, later in pairwise(own)
        ]
        lines.append(Line(name, points))
    return lines


def _names(readings: Sequence[Reading]) -> list[str]:
    return list(dict.fromkeys(reading.process for reading in readings))
