"""Collects the stages' messages in the run's own session: objects, poses, progress and health."""

import time
from collections import Counter, deque
from contextlib import ExitStack
from dataclasses import replace
from typing import Self

import zenoh
from zenoh.handlers import FifoChannel, Handler

from spot3d.colour_alignment import AlignmentWatch
from spot3d.dataflow.alive import watch_alive
from spot3d.dataflow.conversion import calibration_of
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.payload import arrived
from spot3d.dataflow.producers import Producers
from spot3d.dataflow.settings import LinkSettings
from spot3d.run.earlier_streams import MOST as EARLIER_MOST
from spot3d.run.earlier_streams import EarlierStreams
from spot3d.run.from_messages import NoMapError, asked_map, found_objects
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.health_totals import HealthTotals
from spot3d.run.lost_tracking import LostTracking
from spot3d.run.overview import OverviewFrames
from spot3d.run.report import FrameRate, HopTimes, RunReport, StageReport
from spot3d.run.results import MapSnapshot, RunResult, TrackedFrame, empty_snapshot
from spot3d.segments.upper_side import IMAGE_UP, event_of, notice
from spot3d.source.errors import IN_THE_INPUT, NOT_PLAYED
from spot3d.source.sequence import CAMERA_GONE
from spot3d_schemas import STAGES, TOPICS, Health, Message, Objects, Pose, Progress, Proposals, key

_WAITING = 4096
"""Small messages that may wait in a queue: two minutes of a camera's poses."""

POSES_MOST = 100_000
"""Poses that are kept for the overview: the last hour of a camera, 60 MB. The file has them all."""

_BOXES = ("accepted", "masked", "rejected")
"""Events by which the heatmap stage counts proposals."""

_FUSED = (["heatmap", "fusion"], ["segments", "fusion"])
"""The last stages in the trace of a fused frame: live, and lossless, where fusion waits for both."""

_OF_FUSION = (Objects, Progress)
"""Messages that say which stream fusion is in."""


class Collector:
    """Collects what a run reports of its stream; call `drain` often and read the attributes in between.

    A camera whose stamps go back begins another stream, which is followed as soon as fusion is in it; earlier results
    are kept apart. Messages of a second producer are ignored. seen: takes frames of a camera, with their poses, because
    a camera gives them only once.
    """

    def __init__(
        self, session: zenoh.Session, robot: str, stream: str, files: GrowingFiles, seen: OverviewFrames | None = None
    ) -> None:
        self._files, self._seen = files, seen
        self.objects: Objects | None = None
        self.progress: Progress | None = None
        self.health: dict[str, HealthTotals] = {}
        self.poses: deque[TrackedFrame] = deque(maxlen=POSES_MOST)
        self.lost = LostTracking()
        self.latency = HopTimes()
        self.rate = FrameRate()
        self._session = session
        self._robot, self.stream = robot, stream
        self._map = empty_snapshot()
        self.no_map = ""
        self._past: deque[str] = deque(maxlen=EARLIER_MOST)
        self._early: list[Message] = []
        self._earlier = EarlierStreams(files)
        self._news: list[str] = []
        self._told: set[str] = set()
        self._exit = ExitStack()
        self._inputs: dict[str, Handler[zenoh.Sample]] = {}

    def __enter__(self) -> Self:
        self._producers = Producers(self._exit.enter_context(watch_alive(self._session, self._robot)))
        small = ("fusion/objects", "fusion/progress", "pose/pose", "proposals/boxes")
        for topic in (*small, *(f"{stage}/health" for stage in STAGES)):
            ear = self._session.declare_subscriber(key(self._robot, topic), FifoChannel(_WAITING))
            self._inputs[topic] = self._exit.enter_context(ear).handler
        if self._seen is not None:
            self._exit.callback(self._seen.close)
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def drain(self) -> None:
        """Process everything that has come since the last call, stream by stream."""
        self._hear()
        if self._seen is not None:
            self._seen.look(self._session, self.stream, time.monotonic())

    def _hear(self) -> None:
        heard, self._early = self._early, []
        for topic, handler in self._inputs.items():
            for message in arrived(handler, TOPICS[topic].message):
                if self._producers.admit(topic, message.header.sender, time.monotonic()):
                    heard.append(message)
        while heard:
            for message in heard:
                if message.header.stream in (None, self.stream):
                    self._take(message)
            heard = [message for message in heard if message.header.stream not in (None, self.stream, *self._past)]
            # Messages of other stages about a stream wait until fusion is in it.
            begun = next((message.header.stream for message in heard if isinstance(message, _OF_FUSION)), None)
            if begun is None:
                self._early = heard[-_WAITING:]
                return
            self._begin(begun)

    def news(self) -> list[str]:
        """Events to report since the last call: every stream that begins, and every other kind of event once.

        The source's log has each time that the camera was gone, and its events count them.
        """
        kinds = {
            topic: f"another process publishes {topic} as well; its messages are ignored"
            for topic in self._producers.contested(time.monotonic())
        }
        latest = self.latest()
        source, proposals, segments = (latest.get(stage) for stage in ("source", "proposals", "segments"))
        if proposals is not None and AlignmentWatch.EVENT in proposals.events:
            kinds[AlignmentWatch.EVENT] = proposals.state or AlignmentWatch.EVENT
        if source is not None:
            gone = [kind for kind in CAMERA_GONE if kind in source.events]
            kinds |= {kind: f"{kind}: waiting for it (see logs/source.log)" for kind in gone}
        if segments is not None:
            sides = [side for side in IMAGE_UP if event_of(side) in segments.events]
            kinds |= {event_of(side): notice(side) for side in sides}
        news = [*self._news, *(text for kind, text in kinds.items() if kind not in self._told)]
        self._news.clear()
        self._told.update(kinds)
        return news

    def latest(self) -> dict[str, Health]:
        """The last health message of each stage."""
        return {stage: totals.latest for stage, totals in self.health.items()}

    def counts(self) -> tuple[int, Counter[str]]:
        """Frames of all streams so far: how many are fused, and how many are not, by reason."""
        fused, skipped = self._earlier.fused, Counter(self._earlier.skipped)
        if self.progress is not None:
            fused += self.progress.fused
            skipped.update(self.progress.skipped)
        return fused, skipped

    def unsent(self) -> Counter[str]:
        """Frames of the input that were never sent, of which fusion cannot know, by reason."""
        drops = self.health["source"].drops() if "source" in self.health else {}
        return Counter({why: count for why, count in drops.items() if why in NOT_PLAYED or why.endswith(IN_THE_INPUT)})

    def snapshot(self, timeout_s: float) -> MapSnapshot:
        """The stream's map as fusion answers now; if it does not, its last answer, at first an empty map.

        Fusion does not answer while it is busy or gone, nor about this stream once it is in another. `no_map` says why
        it did not the last time, empty if it did.
        """
        self.no_map = ""
        try:
            self._map = asked_map(self._session, self._robot, timeout_s, self.stream)
        except NoMapError as error:
            self.no_map = str(error)
        return self._map

    def result(self, points: MapSnapshot) -> RunResult:
        """The run's result so far."""
        found = RunResult() if self.objects is None else found_objects(self.objects)
        return replace(found, trajectory=tuple(self.poses), points=points)

    def fill(self, report: RunReport, restarts: dict[str, int]) -> None:
        """Enter the counts into the report."""
        fused, skipped = self.counts()
        report.fused, report.skipped = fused, dict(skipped)
        report.lost_poses = self._earlier.lost_poses + self.lost.frames
        report.lost = [*self._earlier.lost, *self.lost.stretches()]
        report.earlier_streams = self._earlier.documents
        report.ms_per_frame = self.rate.ms_per_frame()
        report.latency_ms = self.latency.statistics()
        for stage in STAGES:
            totals, count = self.health.get(stage), restarts.get(stage, 0)
            report.stages[stage] = StageReport(restarts=count) if totals is None else totals.report(count)
            if totals is not None:
                report.drops[stage] = totals.drops()
        report.skipped |= self.unsent()
        if self._seen is not None:
            # The number of a camera's frames is known only once they have come.
            report.played = report.fused + sum(report.skipped.values())
            report.image = self._seen.image
        boxes = report.stages["heatmap"].events
        report.proposals = {kind: boxes[kind] for kind in _BOXES if kind in boxes}
        report.keyframes = report.stages["fusion"].events.get("keyframes", 0)

    def _begin(self, stream: str) -> None:
        """Begin another stream: its map has nothing of the one before, and its stamps may be anything."""
        self._news += self._earlier.leave(self.result(self._map), self.progress, self.lost)
        self._map = empty_snapshot()
        self._past.append(self.stream)
        self.stream = stream
        self.objects, self.progress, self.lost = None, None, LostTracking()
        self.poses.clear()
        if self._seen is not None:
            self._seen.forget()

    def _take(self, message: Message) -> None:
        if isinstance(message, Objects):
            self.objects = message
            self._files.add_update(message.header.stamp_ns, found_objects(message), message.complete)
        elif isinstance(message, Progress):
            self.progress = message
            trace = message.header.trace
            # Not every progress follows one frame through all stages: some report skipped frames or the end.
            self.latency.add(trace, whole="source to fused" if [hop.stage for hop in trace[-2:]] in _FUSED else "")
            fused, skipped = self.counts()
            self.rate.add(fused + skipped.total(), time.monotonic())
        elif isinstance(message, Pose):
            self._pose(message)
            self.latency.add(message.header.trace)
        elif isinstance(message, Proposals):
            self.latency.add(message.header.trace)
        elif isinstance(message, Health) and message.stage in STAGES:
            if message.stage in self.health:
                self.health[message.stage].add(message)
            else:
                self.health[message.stage] = HealthTotals(message)

    def _pose(self, pose: Pose) -> None:
        """Take in a frame's pose; pose providers may repeat poses, or send them out of order."""
        stamp, lost = pose.header.stamp_ns, pose.status == "lost"
        if self.poses and stamp <= self.poses[-1].stamp_ns:
            return
        self.poses.append(TrackedFrame(stamp, pose.T_world_camera, lost, pose.delay_s, calibration_of(pose)))
        self.lost.add(stamp, lost, pose.reason)
        if self._seen is not None:
            self._seen.pose(stamp, None if lost else pose.T_world_camera)
        if not lost:
            self._files.add_pose(stamp, pose.T_world_camera)


def relay_poses(session: zenoh.Session, topic: str, robot: str) -> ExitStack:
    """Forward Pose messages of external odometry, published at the key `topic`, as this robot's."""
    stack = ExitStack()
    publisher = declare_publisher(session, "pose/pose", LinkSettings(robot=robot))
    stack.callback(publisher.undeclare)

    def pass_on(sample: zenoh.Sample) -> None:
        publisher.put(sample.payload, encoding=sample.encoding)

    stack.enter_context(session.declare_subscriber(topic, pass_on))
    return stack
