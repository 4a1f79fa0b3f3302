"""report.json: what a run did with its frames, and what it cost."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

import spot3d
from spot3d.dataflow.clocks import travel_times_ns
from spot3d.dataflow.join import NO_HEAT, NO_POSE
from spot3d.machine import machine
from spot3d.run.lost_tracking import Stretch
from spot3d.run.results import RunResult
from spot3d.source.errors import NOT_PLAYED
from spot3d_schemas import Hop

_TIMES = 10_000
"""Times kept per hop: five minutes of a camera, 0.3 MB; p99 is then of a hundred."""
_HOPS = 16
"""Maximum number of distinct hops: senders can invent stages."""
UNACCOUNTED = "not accounted for"
"""Why a frame of an input that was played to its end is missing, where no stage says why."""


@dataclass(slots=True)
class StageReport:
    """One stage's cost. step_ms: p50, p99 and mean of its core's time for a frame; None: not measured.

    events: counts by kind, such as of a lost camera.
    """

    step_ms: dict[str, float | None] = field(default_factory=dict)
    cpu_s: float | None = None
    rss_mb: float | None = None
    errors: int = 0
    last_error: str = ""
    restarts: int = 0
    events: dict[str, int] = field(default_factory=dict)

    @property
    def only_failed(self) -> bool:
        """Whether its core did nothing but fail."""
        return self.errors > 0 and self.step_ms.get("p50") is None


@dataclass(slots=True)
class RunReport:
    """Counters of a run, in process or distributed, beside what it found (`RunResult`).

    selection: which frames of the input. played: their number. fused, skipped (by reason): what fusion did with them.
    keyframes: those whose segments fusion has taken in. drops: by stage and reason. latency_ms: p50, p99 and mean of
    each hop and of the whole way, from the messages' traces. wall_s: the whole run with the start of its processes.
    ms_per_frame: from the first frame done to the last, per frame. earlier_streams: one document for each stream before
    a camera began anew; they count in `fused`, `skipped` and `lost`, but not in what was found.
    """

    input_name: str
    mode: str
    played: int
    image: tuple[int, int]
    selection: dict[str, Any] = field(default_factory=dict)
    fused: int = 0
    skipped: dict[str, int] = field(default_factory=dict)
    drops: dict[str, dict[str, int]] = field(default_factory=dict)
    lost_poses: int = 0
    lost: list[Stretch] = field(default_factory=list)
    proposals: dict[str, int] = field(default_factory=dict)
    keyframes: int = 0
    wall_s: float = 0.0
    ms_per_frame: float | None = None
    interrupted: bool = False
    stages: dict[str, StageReport] = field(default_factory=dict)
    latency_ms: dict[str, dict[str, float]] = field(default_factory=dict)
    events: list[str] = field(default_factory=list)
    error: str = ""
    earlier_streams: list[dict[str, Any]] = field(default_factory=list)

    @property
    def missing(self) -> int:
        """Frames of the input that are neither fused nor skipped."""
        return max(0, self.played - self.fused - sum(self.skipped.values()))

    def close(self) -> None:
        """Account for every frame of an input that was played to its end, and for each once."""
        twice = self.fused + sum(self.skipped.values()) - self.played
        for why in NOT_PLAYED:
            # A source that was started again has read some frames again, and counted again which it cannot play.
            again = max(0, min(twice, self.skipped.get(why, 0) - 1))
            if again:
                self.skipped[why] -= again
                twice -= again
        if self.missing:
            self.skipped[UNACCOUNTED] = self.missing

    def not_fused(self) -> str:
        """How many frames were not fused, and why, in words; what is missing, the run has not reached."""
        reasons = [f"{count} {reason}" for reason, count in self.skipped.items() if count]
        if self.missing:
            reasons.append(f"{self.missing} not reached")
        said = f"not fused: {', '.join(reasons)}" if reasons else "none dropped"
        return f"interrupted; {said}" if self.interrupted else said

    def nothing_fused(self) -> str:
        """Says why no frame was fused."""
        skipped = {reason: count for reason, count in self.skipped.items() if count}
        reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        # Each pose then counts as a frame whose heat did not come.
        apart = "; poses must have the stamp_ns of their frames" if {NO_POSE, NO_HEAT} <= skipped.keys() else ""
        return f"no frame was fused: {reasons or 'none was received'}{apart}"

    def useless_stage(self) -> str:
        """The stage that did nothing but fail, and its error: the results lack its output. Empty if there is none."""
        failed = (stage for stage, item in self.stages.items() if item.only_failed)
        return next((f"{stage} failed on every frame: {self.stages[stage].last_error}" for stage in failed), "")


def report_document(report: RunReport, result: RunResult) -> dict[str, Any]:
    """The document of report.json; result: what was found so far."""
    known = result.calibration()
    return {
        "version": spot3d.__version__,
        "input": report.input_name,
        "selection": report.selection,
        "mode": report.mode,
        "image": {"width": report.image[0], "height": report.image[1]},
        "frames": {
            "input": report.played,
            "fused": report.fused,
            "skipped": report.skipped,
            "lost_poses": report.lost_poses,
            "lost": [asdict(stretch) for stretch in report.lost],
        },
        "earlier_streams": report.earlier_streams,
        "depth_factor": _rounded(known.depth_factor),
        "delay_s": _rounded(result.delay_s()),
        "turn_deg": [_rounded(math.degrees(angle)) for angle in known.turn],
        "centre": [_rounded(offset) for offset in known.centre],
        "bend": [[round(part, 5) for part in row] for row in known.bend],
        "proposals": report.proposals,
        "keyframes": report.keyframes,
        "keyframes_dropped": result.keyframes_dropped,
        "drops": {stage: reasons for stage, reasons in report.drops.items() if reasons},
        "objects": {"found": len(result.objects), "left_out": result.left_out},
        "map_points": result.points.total,
        "map_limit_reached": result.map_limit_reached,
        "interrupted": report.interrupted,
        "error": report.error or None,
        "wall_s": _rounded(report.wall_s),
        "ms_per_frame": _rounded(report.ms_per_frame),
        "restarts": {stage: item.restarts for stage, item in report.stages.items() if item.restarts},
        "events": report.events,
        "stages": {stage: _stage_document(item) for stage, item in report.stages.items()},
        "latency_ms": {hop: {k: _rounded(v) for k, v in times.items()} for hop, times in report.latency_ms.items()},
        "machine": machine(),
    }


def statistics_ms(milliseconds: Sequence[float]) -> dict[str, float]:
    """p50, p99 and mean of times; empty without any."""
    if not len(milliseconds):
        return {}
    values = np.asarray(milliseconds, dtype=np.float64)
    p50, p99 = np.percentile(values, (50, 99))
    return {"p50": float(p50), "p99": float(p99), "mean": float(values.mean())}


class FrameRate:
    """Time per frame, from counts of the frames done."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self._last: tuple[int, float] | None = None

    def add(self, done: int, now_s: float) -> None:
        """Record that `done` frames are done by now, monotonic seconds."""
        if self._last is None or done != self._last[0]:
            self._last = (done, now_s)
            self._first = self._first or self._last

    def ms_per_frame(self) -> float | None:
        """Milliseconds per frame since the first; None before the second."""
        if self._first is None or self._last is None or self._last[0] <= self._first[0]:
            return None
        return 1e3 * (self._last[1] - self._first[1]) / (self._last[0] - self._first[0])


class HopTimes:
    """Collects the latest travel times of each hop between the stages of traces; bounded, whatever is sent."""

    def __init__(self, most: int = _TIMES) -> None:
        self._most = most
        self._ms: dict[str, deque[float]] = {}

    def add(self, trace: Sequence[Hop], whole: str = "") -> None:
        """Take in one trace; `whole` names the time from the first stage's sending to the last one's."""
        hops = zip(pairwise(trace), travel_times_ns(trace), strict=True)
        times = [(f"{before.stage} to {after.stage}", way_ns) for (before, after), way_ns in hops]
        if whole and len(trace) > 1:
            times.append((whole, trace[-1].sent_ns - trace[0].sent_ns))
        for name, nanoseconds in times:
            if name in self._ms or len(self._ms) < _HOPS:
                self._ms.setdefault(name, deque(maxlen=self._most)).append(nanoseconds / 1e6)

    def statistics(self) -> dict[str, dict[str, float]]:
        """p50, p99 and mean of each hop."""
        return {name: statistics_ms(values) for name, values in self._ms.items()}


def _stage_document(item: StageReport) -> dict[str, Any]:
    step_ms = {name: _rounded(value) for name, value in item.step_ms.items()}
    return asdict(item) | {"step_ms": step_ms, "cpu_s": _rounded(item.cpu_s), "rss_mb": _rounded(item.rss_mb)}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
