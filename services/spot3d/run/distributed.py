"""A run with each stage in a process of its own, all meeting at this process's router."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event

from spot3d.dataflow.streams import new_stream
from spot3d.run.collector import Collector, relay_poses
from spot3d.run.display import Watcher
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.meeting import open_meeting
from spot3d.run.overview_frames import OverviewFrames
from spot3d.run.report import RunReport
from spot3d.run.results import RunResult, empty_snapshot
from spot3d.run.supervisor import Supervisor
from spot3d.settings import Settings
from spot3d.source.selected import Selection
from spot3d_schemas import STAGES, key

_POLL_S = 0.05
_FINAL_OBJECTS_S = 30.0
"""Longest wait for the last update of the objects after the last frame."""
_KEEP_S = 10.0
"""Time between two times that what there is so far is kept."""
_NO_POSE_S = 10.0
"""Somebody else's poses that have not come by then are told of: the stages are there after some four."""
_MAP_S, _MAP_INTERRUPTED_S = 30.0, 2.0
"""Longest wait for the map, at the end and after Ctrl-C."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run, and into which folder. pose_topic: key of someone else's poses, or None.

    listen: endpoints for other programs; usual: one more, if it is free.
    seen: takes some frames of an input that is a camera; None: it is none. stream: the name of the frames' stream,
    which a source that is started again goes on with.
    """

    selection: Selection
    settings: Settings
    folder: Path
    pose_topic: str | None = None
    listen: tuple[str, ...] = ()
    usual: str | None = None
    seen: OverviewFrames | None = None
    stream: str = field(default_factory=new_stream)

    @property
    def logs(self) -> Path:
        """The folder of what the stages say, and of the settings that they are given."""
        return self.folder / "logs"

    @property
    def settings_file(self) -> Path:
        """The stages' settings."""
        return self.logs / "settings.toml"


def run_distributed(
    plan: Plan,
    supervisor: Supervisor,
    report: RunReport,
    files: GrowingFiles,
    watcher: Watcher,
    stop: Event,
    keep: Callable[[RunResult], None],
) -> RunResult:
    """Run every stage as a process of the supervisor until the input ends, `stop` is set or a stage cannot go on.

    Fills the report (`error` says why a run ended that should have gone on). No process is left behind. keep: called
    every ten seconds with what there is so far.
    """
    robot = plan.settings.link.robot
    with ExitStack() as stack:
        apart = _stages_meet_apart(plan)
        meeting = stack.enter_context(open_meeting(plan.settings, plan.listen, plan.usual, apart, watcher))
        session, endpoint = meeting.session, meeting.endpoint
        collector = stack.enter_context(Collector(session, robot, plan.stream, files, plan.seen))
        if plan.pose_topic is not None and plan.pose_topic != key(robot, "pose/pose"):
            stack.enter_context(relay_poses(session, plan.pose_topic, robot))
        for stage in STAGES:
            if stage != "pose" or plan.pose_topic is None:
                supervisor.start(stage, _arguments(plan, stage, endpoint), plan.logs / f"{stage}.log")
        _follow(plan, report, endpoint, supervisor, collector, watcher, stop, keep)
        points = empty_snapshot()
        if collector.progress is not None:
            points = collector.snapshot(_MAP_INTERRUPTED_S if stop.is_set() else _MAP_S)
        supervisor.stop()
        # Each stage says its last counts when it leaves.
        collector.drain()
        for text in collector.news():
            _tell(report, watcher, text)
        collector.fill(report, supervisor.restarts())
        return collector.result(points)


def _stages_meet_apart(plan: Plan) -> bool:
    """Whether the stages meet where nobody else does, so that a slow onlooker of a lossless run holds nobody up.

    Not where somebody from elsewhere is a stage, as whoever gives the poses.
    """
    return plan.settings.link.delivery == "lossless" and plan.pose_topic is None


def _follow(
    plan: Plan,
    report: RunReport,
    endpoint: str,
    supervisor: Supervisor,
    collector: Collector,
    watcher: Watcher,
    stop: Event,
    keep: Callable[[RunResult], None],
) -> None:
    """Watch the stages until the source has ended and the last objects are here."""
    ended_s: float | None = None
    began_s = kept_s = time.monotonic()
    awaited = plan.pose_topic
    while not stop.wait(_POLL_S):
        collector.drain()
        progress, objects = collector.progress, collector.objects
        after_ns = None if progress is None else progress.last_stamp_ns
        again = {"source": _arguments(replace(plan, stream=collector.stream), "source", endpoint, after_ns)}
        for text in collector.news():
            _tell(report, watcher, text)
        for death in supervisor.poll(again):
            _tell(report, watcher, death.message)
            if death.fatal:
                report.error = death.message
                return
        if awaited is not None and (collector.poses or time.monotonic() - began_s > _NO_POSE_S):
            if not collector.poses:
                _tell(report, watcher, f"no pose has come on {awaited}: is it published, and does it reach this run?")
            awaited = None
        if progress is not None:
            found = 0 if objects is None else len(objects.objects)
            fused, skipped = collector.counts()
            watcher.on_progress(fused, skipped.total(), found)
            if time.monotonic() - kept_s >= _KEEP_S:
                collector.fill(report, supervisor.restarts())
                keep(collector.result(collector.snapshot(_MAP_INTERRUPTED_S)))
                kept_s = time.monotonic()
        if supervisor.finished("source"):
            ended_s = ended_s or time.monotonic()
            if progress is None or progress.fused == 0 or (objects is not None and objects.complete):
                return
            if time.monotonic() - ended_s > _FINAL_OBJECTS_S:
                waited = f"the last update of the objects did not come in {_FINAL_OBJECTS_S:g} s"
                report.error = f"{waited}; {plan.logs / 'fusion.log'} may say why"
                return
    report.interrupted = True
    supervisor.end("source")


def _tell(report: RunReport, watcher: Watcher, text: str) -> None:
    report.events.append(text)
    watcher.on_event(text)


def _arguments(plan: Plan, stage: str, endpoint: str, after_ns: int | None = None) -> list[str]:
    """Command line of one stage; `after_ns`: a source that is started again goes on after this stamp."""
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
    if after_ns is not None:
        arguments += ["--after-ns", str(after_ns)]
    return [selection.name, *arguments]
