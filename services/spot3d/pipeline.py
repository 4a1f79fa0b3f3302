"""The six stages' cores in one process: the reference that a distributed run must equal."""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from spot3d.camera_pose import CameraPose
from spot3d.dataflow.cadence import Cadence
from spot3d.dataflow.order import DUPLICATE, OUT_OF_ORDER
from spot3d.failures import Failures
from spot3d.found_object import FoundObjects
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.worlds import World
from spot3d.heatmap.heat import Heatmap, weighted_heat
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.providers import make_tracker
from spot3d.proposals.propose import propose
from spot3d.segments.keyframe_segments import KeyframeSegments
from spot3d.settings import Settings
from spot3d.source.errors import IN_THE_INPUT, UNREADABLE, UNSENDABLE
from spot3d.source.sequence import FrameSequence
from spot3d_schemas.limits import MAX_COUNT

LOST, FAILED = "lost pose", "error"
"""Why a readable frame is not fused: its pose is not trusted, or fusing it failed."""


@dataclass(frozen=True, slots=True)
class PipelineStep:
    """What happened to one frame.

    segments: only of a keyframe; objects: only if this frame was due for an update of the objects; refused: why it was
    not fused, empty if it was; side_up: the side of the image that seems to be up though `segments.image_up` names
    another, mostly empty.
    """

    frame: RgbdFrame
    pose: PoseEstimate
    heat: Heatmap
    segments: FrameSegments | None
    objects: FoundObjects | None
    refused: str
    side_up: str


@dataclass(slots=True)
class PipelineResult:
    """Everything a run leaves behind.

    keyframes: number of those whose segments fusion took in. trajectory: stamp in ns and pose of each frame. skipped:
    number of frames that were not fused, by reason; unreadable: why the last unreadable one could not be read. step_s:
    seconds that each stage's core took for each of its frames; segments: for each keyframe, with the frames remembered
    until the next one. heat_counts: proposals accepted, masked and rejected in all frames. fusion: the final map;
    complete: whether `objects` are those of that map. failures: of the cores; each cost a frame that core's result.
    """

    fusion: Fusion
    objects: FoundObjects
    keyframes: int = 0
    trajectory: list[tuple[int, PoseEstimate]] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)
    unreadable: str = ""
    step_s: dict[str, list[float]] = field(default_factory=dict)
    heat_counts: Counter[str] = field(default_factory=Counter)
    complete: bool = False
    failures: Failures = field(default_factory=Failures)


def run_pipeline(
    sequence: FrameSequence,
    settings: Settings,
    on_frame: Callable[[PipelineStep], None] | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> PipelineResult:
    """Run every frame through all cores, in order, and update the objects at the cadence of capture time.

    A frame is skipped and counted, as in a distributed run, if it cannot be read, if its stamp is not later than that
    of the frame before, or if no camera can have its pose. A frame on which a core fails has a lost pose, no boxes, no
    heat or no segments, or is not fused.
    `on_frame` is called after each frame. Once `stopped` returns True, the run ends early with what there is.
    """
    cores = _Cores(settings)
    for index in range(len(sequence)):
        if stopped():
            break
        frame = _next_frame(sequence, index, cores.result, cores.last_ns)
        if frame is not None:
            step = cores.take(frame)
            if on_frame is not None:
                on_frame(step)
    cores.end()
    return cores.result


def _next_frame(sequence: FrameSequence, index: int, result: PipelineResult, last_ns: int) -> RgbdFrame | None:
    """The frame if a source would send it and it is later than `last_ns`; else the reason is counted."""
    try:
        with _timed(result.step_s, "source"):
            frame = sequence[index]
    except Exception as error:  # a file that cannot be opened any more costs a frame, as in a distributed run
        result.skipped[UNREADABLE] += 1
        result.unreadable = str(error)
        return None
    if not 0 <= frame.stamp_ns <= MAX_COUNT:
        result.skipped[UNSENDABLE] += 1
        result.unreadable = f"the frame at {frame.stamp_ns} ns {UNSENDABLE}: its timestamp is out of range"
        return None
    if frame.stamp_ns <= last_ns:
        result.skipped[f"{DUPLICATE if frame.stamp_ns == last_ns else OUT_OF_ORDER} {IN_THE_INPUT}"] += 1
        return None
    return frame


class _Cores:
    """The stages' cores, which take one frame after the other. last_ns: stamp of the last one."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._tracker, self._fusion = make_tracker(settings.pose), Fusion(settings.fusion)
        self._keyframes, self._world = KeyframeSegments(settings.segments), World(settings.fusion.speed_max)
        self._cadence = Cadence(settings.fusion.object_interval_s)
        self._pose = PoseEstimate(np.eye(4), "lost")
        self.result, self.last_ns = PipelineResult(self._fusion, self._fusion.objects()), -1

    def take(self, frame: RgbdFrame) -> PipelineStep:
        """Pass a frame from core to core."""
        self.last_ns = frame.stamp_ns
        pose = self._pose = self._tracked(frame)
        heat = self._heat(frame)
        self.result.trajectory.append((frame.stamp_ns, pose))
        segments, update, refused = None, None, LOST
        if pose.status == "ok":
            segments = self._segments(frame, heat, pose)
            refused = self._fuse(frame, heat, pose, segments)
        if refused:
            self.result.skipped[refused] += 1
        elif self._cadence.due(frame.stamp_ns):
            update = self._objects(lasting=True)
        return PipelineStep(frame, pose, heat, segments, update, refused, self._keyframes.side_up)

    def end(self) -> None:
        """Find the last objects."""
        self.result.complete = self._objects(lasting=False) is not None

    def _tracked(self, frame: RgbdFrame) -> PoseEstimate:
        """The frame's pose; if the tracker fails, a lost one with the last pose."""
        try:
            with _timed(self.result.step_s, "pose"):
                return self._tracker.track(frame)
        except Exception as error:
            why = self.result.failures.add("pose", f"no pose of the frame at {frame.stamp_ns} ns", error)
            return PoseEstimate(self._pose.T_world_camera, "lost", why)

    def _heat(self, frame: RgbdFrame) -> Heatmap:
        """The heat of a frame's proposals; none if either core fails."""
        depth, camera, where = frame.depth_metres(), frame.intrinsics, f"the frame at {frame.stamp_ns} ns"
        failures, step_s = self.result.failures, self.result.step_s
        boxes = np.zeros((0, 5), np.float32)
        with failures.of("proposals", f"no proposals for {where}"), _timed(step_s, "proposals"):
            boxes = propose(frame.colour, depth, camera, self._settings.proposals)
        heat = Heatmap(np.zeros(depth.shape, np.uint8), 0, 0, len(boxes))
        with failures.of("heatmap", f"no heat for {where}"), _timed(step_s, "heatmap"):
            heat = weighted_heat(depth, camera, boxes, self._settings.heatmap)
        self.result.heat_counts.update(accepted=heat.accepted, masked=heat.masked, rejected=heat.rejected)
        return heat

    def _segments(self, frame: RgbdFrame, heat: Heatmap, pose: PoseEstimate) -> FrameSegments | None:
        """The segments of a keyframe; None for other frames, or if the core fails."""
        segments, step_s = None, self.result.step_s
        if self._keyframes.wants(frame.stamp_ns, pose.T_world_camera):
            with self.result.failures.of("segments", f"no segments of the frame at {frame.stamp_ns} ns"):
                with _timed(step_s, "segments"):
                    segments = self._keyframes.find(frame, heat.heat, pose.T_world_camera, pose.calibration)
                if segments is None:
                    times = step_s["segments"]
                    times[-2:] = [sum(times[-2:])]  # its time belongs to the keyframe before
        return segments

    def _fuse(self, frame: RgbdFrame, heat: Heatmap, pose: PoseEstimate, segments: FrameSegments | None) -> str:
        """Fuse a frame with a trusted pose, and its segments; returns why it was not fused, empty if it was."""
        verdict = self._world.judge(None, pose.T_world_camera, frame.stamp_ns)
        if verdict != "same":
            return verdict
        refused, fusion, failures = FAILED, self._fusion, self.result.failures
        depth, where = frame.depth_metres(), f"the frame at {frame.stamp_ns} ns"
        known = CameraPose(
            pose.T_world_camera, pose.T_world_map, calibration=pose.calibration, corrections=pose.corrections
        )
        stamp_ns = None if segments is None else frame.stamp_ns
        with failures.of("fusion", f"cannot fuse {where}"), _timed(self.result.step_s, "fusion"):
            fusion.fuse(frame.colour, depth, heat.heat, frame.intrinsics, known, stamp_ns)
            refused = ""
            if segments is not None:
                with failures.of("fusion", f"cannot use the segments of {where}"):
                    fusion.observe(segments, frame.stamp_ns)
                    self.result.keyframes += 1
        if not refused:
            self._world.follow(None, pose.T_world_camera, frame.stamp_ns)
        return refused

    def _objects(self, lasting: bool) -> FoundObjects | None:
        """An update of the objects; None if it fails."""
        said = f"no objects after {self._fusion.frame_count} frames"
        with self.result.failures.of("fusion", said), _timed(self.result.step_s, "objects"):
            self.result.objects = self._fusion.objects(lasting)
            return self.result.objects
        return None


@contextmanager
def _timed(step_s: dict[str, list[float]], stage: str) -> Iterator[None]:
    """Record the time that the block takes, unless it fails."""
    start = time.perf_counter()
    yield
    step_s.setdefault(stage, []).append(time.perf_counter() - start)
