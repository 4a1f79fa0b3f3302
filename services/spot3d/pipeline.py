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
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import FoundObjects, Fusion
from spot3d.fusion.worlds import World
from spot3d.heatmap.heat import Heatmap, weighted_heat
from spot3d.pose.estimate import PoseEstimate, PoseTracker
from spot3d.pose.providers import make_tracker
from spot3d.proposals.propose import propose
from spot3d.segments.keyframe_segments import KeyframeSegments
from spot3d.settings import Settings
from spot3d.source.errors import IN_THE_INPUT, UNREADABLE, UNSENDABLE
from spot3d.source.sequence import FrameSequence
from spot3d_schemas.limits import MAX_COUNT

LOST, FAILED = "lost pose", "error"
"""Why a frame is not fused that can be read: it has no trusted pose, or fusing it failed."""


@dataclass(frozen=True, slots=True)
class PipelineStep:
    """What happened to one frame.

    segments: only of a keyframe; objects: only where this frame was due for an update of the objects; refused: why it
    was not fused, empty where it was; side_up: the side of the image that seems to be up by now in the place of
    `segments.image_up`, mostly empty.
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

    keyframes: those whose segments fusion has taken in. trajectory: stamp in ns and pose of each frame. skipped: frames
    that were not fused, by reason; unreadable: why the last of those could not be read. step_s: seconds that each
    stage's core took for each of its frames; segments: for each keyframe, and what is remembered until the next one.
    heat_counts: proposals accepted, masked and rejected in all frames. fusion: the final map; complete: `objects` are
    those of that. failures: of the cores, which cost a frame what the core would have made of it.
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
    """Run every frame through all cores, in order, and find the objects whenever capture time says so.

    A frame that cannot be read, whose stamp is not later than that of the frame before, or whose pose no camera can
    have is skipped and counted, as it is in a distributed run. So is one that a core fails on: it has a lost pose, no
    boxes, no heat or no segments, or is not fused.
    `on_frame` is called after each frame; once `stopped` says so, the run ends early with what there is.
    """
    tracker, fusion = make_tracker(settings.pose), Fusion(settings.fusion)
    keyframes, world = KeyframeSegments(settings.segments), World(settings.fusion.speed_max)
    cadence = Cadence(settings.fusion.object_interval_s)
    result, last_ns = PipelineResult(fusion, fusion.objects()), -1
    failures, step_s, pose = result.failures, result.step_s, PoseEstimate(np.eye(4), "lost")
    for index in range(len(sequence)):
        if stopped():
            break
        try:
            with _timed(step_s, "source"):
                frame = sequence[index]
        except Exception as error:  # a file that cannot be opened any more costs a frame, as in a distributed run
            result.skipped[UNREADABLE] += 1
            result.unreadable = str(error)
            continue
        if not 0 <= frame.stamp_ns <= MAX_COUNT:
            result.skipped[UNSENDABLE] += 1
            result.unreadable = f"the frame of {frame.stamp_ns} ns {UNSENDABLE}: no message holds such a time"
            continue
        if frame.stamp_ns <= last_ns:
            result.skipped[f"{DUPLICATE if frame.stamp_ns == last_ns else OUT_OF_ORDER} {IN_THE_INPUT}"] += 1
            continue
        last_ns = frame.stamp_ns
        depth, camera, where = frame.depth_metres(), frame.intrinsics, f"the frame at {frame.stamp_ns} ns"
        pose = _tracked(tracker, frame, pose, result)
        boxes = np.zeros((0, 5), np.float32)
        with failures.of("proposals", f"no proposals for {where}"), _timed(step_s, "proposals"):
            boxes = propose(frame.colour, depth, camera, settings.proposals)
        heat = Heatmap(np.zeros(depth.shape, np.uint8), 0, 0, len(boxes))
        with failures.of("heatmap", f"no heat for {where}"), _timed(step_s, "heatmap"):
            heat = weighted_heat(depth, camera, boxes, settings.heatmap)
        result.trajectory.append((frame.stamp_ns, pose))
        result.heat_counts.update(accepted=heat.accepted, masked=heat.masked, rejected=heat.rejected)
        segments, update, refused = None, None, LOST
        if pose.status == "ok":
            if keyframes.wants(frame.stamp_ns, pose.T_world_camera):
                with failures.of("segments", f"no segments of {where}"):
                    with _timed(step_s, "segments"):
                        segments = keyframes.find(frame, heat.heat, pose.T_world_camera, pose.calibration)
                    if segments is None:
                        _join_last_two(step_s["segments"])
            verdict = world.judge(None, pose.T_world_camera, frame.stamp_ns)
            refused = "" if verdict == "same" else verdict
        if not refused:
            refused = FAILED
            known = CameraPose(
                pose.T_world_camera, pose.T_world_map, calibration=pose.calibration, corrections=pose.corrections
            )
            with failures.of("fusion", f"cannot fuse {where}"), _timed(step_s, "fusion"):
                fusion.fuse(frame.colour, depth, heat.heat, camera, known, frame.stamp_ns)
                refused = ""
                if segments is not None:
                    with failures.of("fusion", f"cannot use the segments of {where}"):
                        fusion.observe(segments, frame.stamp_ns)
                        result.keyframes += 1
        if refused:
            result.skipped[refused] += 1
        else:
            world.follow(None, pose.T_world_camera, frame.stamp_ns)
            if cadence.due(frame.stamp_ns):
                with failures.of("fusion", f"no objects after {fusion.frame_count} frames"), _timed(step_s, "objects"):
                    update = result.objects = fusion.objects()
        if on_frame is not None:
            on_frame(PipelineStep(frame, pose, heat, segments, update, refused, keyframes.side_up))
    with failures.of("fusion", f"no objects after {fusion.frame_count} frames"):
        result.objects, result.complete = fusion.objects(), True
    return result


def _tracked(tracker: PoseTracker, frame: RgbdFrame, last: PoseEstimate, result: PipelineResult) -> PoseEstimate:
    """The frame's pose: a lost one, where the last was, if the tracker fails on it."""
    try:
        with _timed(result.step_s, "pose"):
            return tracker.track(frame)
    except Exception as error:
        why = result.failures.add("pose", f"no pose of the frame at {frame.stamp_ns} ns", error)
        return PoseEstimate(last.T_world_camera, "lost", why)


@contextmanager
def _timed(step_s: dict[str, list[float]], stage: str) -> Iterator[None]:
    """Keep the time that the block took, unless it fails."""
    start = time.perf_counter()
    yield
    step_s.setdefault(stage, []).append(time.perf_counter() - start)


def _join_last_two(times: list[float]) -> None:
    times[-2:] = [sum(times[-2:])]
