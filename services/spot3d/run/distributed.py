"""A run with each stage in a process of its own, all connected to this process's router."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from pathlib import Path

from spot3d.dataflow.streams import new_stream
from spot3d.run.collector import Collector, relay_poses
from spot3d.run.display import RunMonitor
from spot3d.run.overview import OverviewFrames
from spot3d.run.results import MapSnapshot, RunResult, empty_snapshot
from spot3d.run.run_router import open_run_router
from spot3d.run.silence import Silence
from spot3d.run.stage_files import LOGS, SETTINGS
from spot3d.run.supervisor import Supervisor
from spot3d.settings import Settings
from spot3d.source.selected import Selection
from spot3d_schemas import STAGES, key

_POLL_S = 0.05
_FINAL_OBJECTS_S = 30.0
"""Longest wait for the last update of the objects after the last frame."""
_KEEP_S = 10.0
"""Interval at which the results so far are saved."""
_NO_POSE_S = 10.0
"""External poses that have not come by then are reported: the stages are there after some four."""
_SLOW_START_S = 8.0
"""Stages that are not on line by then are said to be waited for: with compiled kernels on two cores they take four."""
_MAP_S, _MAP_INTERRUPTED_S = 30.0, 2.0
"""Longest wait for the map, at the end and after Ctrl-C."""

Keep = Callable[[RunResult], None]
"""Saves the results so far."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run, and into which folder. pose_topic: key of external poses, or None.

    listen: endpoints for other programs. usual: one more, if it is free. seen: takes some frames of a camera; None: the
    input is none. stamps_ns: of the input's frames; empty for a camera. stream: the name of the frames' stream, which a
    restarted source continues.
    """

    selection: Selection
    settings: Settings
    folder: Path
    pose_topic: str | None = None
    listen: tuple[str, ...] = ()
    usual: str | None = None
    seen: OverviewFrames | None = None
    stamps_ns: Sequence[int] = ()
    stream: str = field(default_factory=new_stream)

    @property
    def logs(self) -> Path:
        """The folder of the stages' logs and settings."""
        return self.folder / LOGS

    @property
    def settings_file(self) -> Path:
        """The stages' settings."""
        return self.logs / SETTINGS


def run_distributed(plan: Plan, supervisor: Supervisor, monitor: RunMonitor, keep: Keep) -> RunResult:
    """Run every stage as a process of the supervisor until the input ends, `stop` is set or a stage cannot go on.

    Fills the report (`error`: why the run ended early). No process is left behind. keep: called every ten seconds with
    the result so far.
    """
    robot = plan.settings.link.robot
    with ExitStack() as stack:
        # With it a slow onlooker does not stall a lossless run, but external poses could not come in, either.
        apart = plan.settings.link.delivery == "lossless" and plan.pose_topic is None
        router = open_run_router(plan.settings, plan.listen, plan.usual, apart, monitor.watcher)
        session, endpoint = stack.enter_context(router)
        collector = stack.enter_context(Collector(session, robot, plan.stream, monitor.files, plan.seen))
        if plan.pose_topic is not None and plan.pose_topic != key(robot, "pose/pose"):
            stack.enter_context(relay_poses(session, plan.pose_topic, robot))
        for stage in STAGES:
            if stage != "pose" or plan.pose_topic is None:
                supervisor.start(stage, _arguments(plan, stage, endpoint), plan.logs / f"{stage}.log")
        _follow(plan, endpoint, supervisor, collector, monitor, keep)
        points = _last_map(collector, monitor)
        supervisor.stop()
        # Each stage says its last counts when it leaves.
        collector.drain()
        monitor.tell(*collector.news())
        collector.fill(monitor.report, supervisor.restarts())
        return collector.result(points)


def _follow(
    plan: Plan, endpoint: str, supervisor: Supervisor, collector: Collector, monitor: RunMonitor, keep: Keep
) -> None:
    """Watch the stages until the source has ended and the last objects are here."""
    report, awaited, began_s = monitor.report, plan.pose_topic, time.monotonic()
    kept_s, ended_s, silence = began_s, inf, Silence(plan.settings.link.health_interval_s)
    source_again, slow_start = partial(_source_again, plan, endpoint, collector), False
    while not monitor.stop.wait(_POLL_S):
        collector.drain()
        monitor.tell(*collector.news())
        if not slow_start and time.monotonic() - began_s > _SLOW_START_S:
            slow_start = True
            if waited_for := sorted(supervisor.processes().keys() - collector.latest().keys() - {"source"}):
                monitor.watcher.on_note(f"waiting for {', '.join(waited_for)}; the first run compiles their kernels")
        for stage in silence.look(collector.latest(), supervisor.processes(), time.monotonic()):
            monitor.tell(f"{stage} has not responded for {silence.limit_s(stage):.0f} s; it hangs and is killed")
            supervisor.kill(stage)
        for death in supervisor.poll({"source": source_again}):
            monitor.tell(death.message)
            if death.fatal:
                report.error = death.message
                return
        if awaited is not None and (collector.poses or time.monotonic() - began_s > _NO_POSE_S):
            if not collector.poses:
                monitor.tell(
                    f"no pose has come on {awaited}: check that it is published, and that this run can receive it"
                )
            awaited = None
        if collector.progress is not None:
            _show(collector, monitor)
            if time.monotonic() - kept_s >= _KEEP_S:
                collector.fill(report, supervisor.restarts())
                keep(collector.result(collector.snapshot(_MAP_INTERRUPTED_S)))
                kept_s = time.monotonic()
        if supervisor.children["source"].finished:
            ended_s = min(ended_s, time.monotonic())
            if _complete(collector):
                return
            if time.monotonic() - ended_s > _FINAL_OBJECTS_S:
                waited = f"the last update of the objects did not come within {_FINAL_OBJECTS_S:g} s"
                report.error = f"{waited}; see {plan.logs / 'fusion.log'}"
                return
    report.interrupted = True
    supervisor.end("source")


def _last_map(collector: Collector, monitor: RunMonitor) -> MapSnapshot:
    """The map at the end of the run; it is reported if fusion does not send it."""
    if collector.progress is None:
        return empty_snapshot()
    points = collector.snapshot(_MAP_INTERRUPTED_S if monitor.stop.is_set() else _MAP_S)
    if collector.no_map:
        monitor.tell(f"no final map: {collector.no_map}; heatmap.ply has an earlier one, of {points.total} points")
    return points


def _show(collector: Collector, monitor: RunMonitor) -> None:
    """Show how far the run is."""
    objects, (fused, skipped) = collector.objects, collector.counts()
    monitor.watcher.on_progress(fused, skipped.total(), 0 if objects is None else len(objects.objects))


def _complete(collector: Collector) -> bool:
    """Whether all results of a source that has ended are here: the last objects, if there are any."""
    progress, objects = collector.progress, collector.objects
    return progress is None or progress.fused == 0 or (objects is not None and objects.complete)


def _source_again(plan: Plan, endpoint: str, collector: Collector) -> list[str]:
    """Command line of a restarted source, which goes on after the last frame that is accounted for."""
    progress, plan = collector.progress, replace(plan, stream=collector.stream)
    if progress is None:
        return _arguments(plan, "source", endpoint)
    after_ns = progress.last_stamp_ns
    # Fusion has forgotten some frames if it was started again; how many a camera has sent, nobody else knows.
    begun = sum(stamp_ns <= after_ns for stamp_ns in plan.stamps_ns) - collector.unsent().total()
    sent = max(begun, progress.fused + sum(progress.skipped.values()))
    return [*_arguments(plan, "source", endpoint), "--after-ns", str(after_ns), "--sent", str(sent)]


def _arguments(plan: Plan, stage: str, endpoint: str) -> list[str]:
    """Command line of one stage."""
    arguments = ["--settings", str(plan.settings_file), "--connect", endpoint, "--supervised"]
    if stage != "source":
        return arguments
    selection = plan.selection
    arguments += ["--every", str(selection.every)]
    if selection.frames is not None:
        arguments += ["--frames", str(selection.frames)]
    if selection.intrinsics is not None:
        arguments += ["--intrinsics", ",".join(repr(value) for value in selection.intrinsics)]
    if plan.pose_topic is not None:
        arguments.append("--no-pose-stage")
    arguments += ["--stream", plan.stream]
    return [selection.name, *arguments]
