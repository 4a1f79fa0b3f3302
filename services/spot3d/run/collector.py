"""What the run's own session hears of the stages: objects, poses, progress and health."""

import time
from collections import Counter, deque
from contextlib import ExitStack
from dataclasses import replace
from typing import Self, TypeVar

import numpy as np
import zenoh
from zenoh.handlers import FifoChannel, Handler

from spot3d.boxes import Box3D
from spot3d.dataflow.alive import watch_alive
from spot3d.dataflow.conversion import calibration_of
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.producers import Producers
from spot3d.dataflow.settings import LinkSettings
from spot3d.found_object import FoundObject
from spot3d.run.lost_tracking import LostTracking
from spot3d.run.report import FrameRate, HopTimes, RunReport, StageReport
from spot3d.run.results import MapSnapshot, RunResult, TrackedFrame, empty_snapshot
from spot3d.run.timeline import Timeline
from spot3d.run.trajectory_file import TrajectoryFile
from spot3d.source.errors import IN_THE_INPUT, NOT_PLAYED
from spot3d.source.sequence import CAMERA_GONE
from spot3d_schemas import (
    STAGES,
    TOPICS,
    CodecError,
    Header,
    Health,
    MapPoints,
    Message,
    Objects,
    Pose,
    Progress,
    Proposals,
    decode,
    key,
)

_WAITING = 4096
"""Small messages that may wait for this process: two minutes of a camera's poses."""

POSES_MOST = 100_000
"""Poses that are kept for the overview: the last hour of a camera, 60 MB. The file has them all."""

_BOXES = ("accepted", "masked", "rejected")
"""What the heatmap stage counts of the proposals."""

_FUSED = (["heatmap", "fusion"], ["segments", "fusion"])
"""The last stages that a fused frame went through: live, and lossless, where fusion waits for both."""

M = TypeVar("M", bound=Message)


class Collector:
    """Collects what a run reports of its stream; call `drain` often and read the attributes in between.

    Other streams' messages are not this run's, nor is what a second producer says.
    """

    def __init__(
        self, session: zenoh.Session, robot: str, stream: str, timeline: Timeline, trajectory: TrajectoryFile
    ) -> None:
        self._timeline, self._trajectory = timeline, trajectory
        self.objects: Objects | None = None
        self.progress: Progress | None = None
        self.health: dict[str, Health] = {}
        self.poses: deque[TrackedFrame] = deque(maxlen=POSES_MOST)
        self.lost = LostTracking()
        self.latency = HopTimes()
        self.rate = FrameRate()
        self._session = session
        self._robot, self._stream = robot, stream
        self._told: set[str] = set()
        self._earlier: dict[str, Counter[str]] = {stage: Counter() for stage in STAGES}
        self._earlier_events: dict[str, Counter[str]] = {stage: Counter() for stage in STAGES}
        self._exit = ExitStack()
        self._inputs: dict[str, Handler[zenoh.Sample]] = {}

    def __enter__(self) -> Self:
        self._producers = Producers(self._exit.enter_context(watch_alive(self._session, self._robot)))
        small = ("fusion/objects", "fusion/progress", "pose/pose", "proposals/boxes")
        for topic in (*small, *(f"{stage}/health" for stage in STAGES)):
            subscriber = self._session.declare_subscriber(key(self._robot, topic), FifoChannel(_WAITING))
            self._exit.callback(subscriber.undeclare)
            self._inputs[topic] = subscriber.handler
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def drain(self) -> None:
        """Take in everything that has come since the last call."""
        for topic, handler in self._inputs.items():
            while (sample := handler.try_recv()) is not None:
                message = decoded(sample, TOPICS[topic].message)
                if message is not None and self._is_of_this_run(topic, message.header):
                    self._take(message)

    def contested(self) -> list[str]:
        """What else is to be told: each topic that somebody else says as well, once."""
        new = set(self._producers.contested(time.monotonic())) - self._told
        self._told |= new
        return [f"{topic} is said by another process as well, which is not listened to" for topic in sorted(new)]

    def camera_news(self) -> list[str]:
        """What there is to tell of a camera, each kind once; the source's log has every time, its events how many."""
        health = self.health.get("source")
        events = {} if health is None else health.events
        new = [kind for kind in CAMERA_GONE if kind in events and kind not in self._told]
        self._told.update(new)
        return [f"{kind}: it is waited for (logs/source.log)" for kind in new]

    def _is_of_this_run(self, topic: str, header: Header) -> bool:
        ours = header.stream in (None, self._stream)
        return ours and self._producers.admit(topic, header.sender, time.monotonic())

    def snapshot(self, timeout_s: float) -> MapSnapshot:
        """The map as fusion answers now; empty where it does not answer."""
        return asked_map(self._session, self._robot, timeout_s)

    def result(self, points: MapSnapshot) -> RunResult:
        """The run's result as it is known now."""
        found = RunResult() if self.objects is None else found_objects(self.objects)
        return replace(found, trajectory=tuple(self.poses), points=points)

    def fill(self, report: RunReport, restarts: dict[str, int]) -> None:
        """Enter what was counted into the report."""
        if self.progress is not None:
            report.fused, report.skipped = self.progress.fused, dict(self.progress.skipped)
        report.lost_poses, report.lost = self.lost.frames, self.lost.stretches()
        report.ms_per_frame = self.rate.ms_per_frame()
        report.latency_ms = self.latency.statistics()
        for stage in STAGES:
            health = self.health.get(stage)
            item = StageReport(restarts=restarts.get(stage, 0))
            if health is not None:
                item.step_ms = {"p50": health.step_ms_p50, "p99": health.step_ms_p99}
                item.cpu_s, item.rss_mb = health.cpu_s, health.rss_bytes / 2**20
                item.errors, item.last_error = health.errors, health.last_error
                report.drops[stage] = dict(self._earlier[stage] + Counter(health.drops))
                item.events = dict(self._earlier_events[stage] + Counter(health.events))
            report.stages[stage] = item
        # Fusion cannot know of frames that were never sent.
        unsent = report.drops.get("source", {})
        unsent = {why: count for why, count in unsent.items() if why in NOT_PLAYED or why.endswith(IN_THE_INPUT)}
        report.skipped |= unsent
        boxes = report.stages["heatmap"].events
        report.proposals = {kind: boxes[kind] for kind in _BOXES if kind in boxes}
        fusion = self.health.get("fusion")
        report.keyframes = 0 if fusion is None else fusion.events.get("keyframes", 0)

    def _take(self, message: Message) -> None:
        if isinstance(message, Objects):
            self.objects = message
            self._timeline.add_update(message.header.stamp_ns, found_objects(message), message.complete)
        elif isinstance(message, Progress):
            self.progress = message
            hops = _hops(message.header)
            # Not every progress is of one frame that went the whole way: some are of skipped frames or of the end.
            self.latency.add(hops, whole="source to fused" if [hop[0] for hop in hops[-2:]] in _FUSED else "")
            self.rate.add(message.fused + sum(message.skipped.values()), time.monotonic())
        elif isinstance(message, Pose):
            self._pose(message)
            self.latency.add(_hops(message.header))
        elif isinstance(message, Proposals):
            self.latency.add(_hops(message.header))
        elif isinstance(message, Health):
            last = self.health.get(message.stage)
            if last is not None and last.pid != message.pid:
                self._earlier[message.stage] += Counter(last.drops)
                self._earlier_events[message.stage] += Counter(last.events)
            self.health[message.stage] = message

    def _pose(self, pose: Pose) -> None:
        """A frame's pose; whoever gives poses may say one twice, and out of order."""
        stamp, lost = pose.header.stamp_ns, pose.status == "lost"
        if self.poses and stamp <= self.poses[-1].stamp_ns:
            return
        self.poses.append(TrackedFrame(stamp, pose.T_world_camera, lost, pose.delay_s, calibration_of(pose)))
        self.lost.add(stamp, lost, pose.reason)
        if not lost:
            self._trajectory.add_pose(stamp, pose.T_world_camera)


def asked_map(session: zenoh.Session, robot: str, timeout_s: float) -> MapSnapshot:
    """The map as a robot's fusion answers now; empty where it does not answer."""
    for reply in session.get(key(robot, "fusion/map"), timeout=timeout_s):
        message = decoded(reply.ok, MapPoints) if reply.ok is not None else None
        if message is not None:
            return MapSnapshot(message.xyz, message.rgb, message.heat, message.frequency, message.total)
    return empty_snapshot()


def relay_poses(session: zenoh.Session, topic: str, robot: str) -> ExitStack:
    """Pass on Pose messages of someone else's odometry, published at the key `topic`, as this robot's."""
    stack = ExitStack()
    publisher = declare_publisher(session, "pose/pose", LinkSettings(robot=robot))
    stack.callback(publisher.undeclare)

    def pass_on(sample: zenoh.Sample) -> None:
        publisher.put(sample.payload, encoding=sample.encoding)

    subscriber = session.declare_subscriber(topic, pass_on)
    stack.callback(subscriber.undeclare)
    return stack


def found_objects(message: Objects) -> RunResult:
    """The objects of an update."""
    return RunResult(
        objects=tuple(
            FoundObject(
                item.id,
                Box3D(item.centre, item.size, item.rotation),
                item.confidence,
                item.views,
                item.points,
                np.array(item.colour, np.float64),
            )
            for item in message.objects
        ),
        up=(float(message.up[0]), float(message.up[1]), float(message.up[2])),
        frame_count=message.frame_count,
        left_out=dict(message.left_out),
        keyframes_dropped=message.keyframes_dropped,
        map_limit_reached=message.map_limit_reached,
    )


def _hops(header: Header) -> list[tuple[str, int, int]]:
    return [(hop.stage, hop.received_ns, hop.sent_ns) for hop in header.trace]


def decoded(sample: zenoh.Sample, expected: type[M]) -> M | None:
    """The message, or None where it is none: whoever sends nonsense must not end the run."""
    try:
        return decode(sample.payload.to_bytes(), expected)
    except CodecError:
        return None
