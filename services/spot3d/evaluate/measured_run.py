"""Runs the whole method over a labelled sequence and measures what the tables need."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, iou_matrix_2d, moved
from spot3d.camera import Intrinsics, invert
from spot3d.evaluate.carried import Sightings
from spot3d.evaluate.judgement import Found, Judged, judge
from spot3d.evaluate.labelled import LabelledSequence
from spot3d.evaluate.peer_map import PeerMap
from spot3d.evaluate.points import SortedPoints
from spot3d.evaluate.projection import box_surface, boxes_in_view, thinned
from spot3d.evaluate.stability import Update
from spot3d.evaluate.truth import LabelledScene
from spot3d.pipeline import PipelineResult, PipelineStep, run_pipeline
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.source.sequence import FrameSequence
from spot3d.trajectory import ate, nearest_rotation

VIEWS_2D = 50
"""2D overlap is measured in about this many frames, evenly spread."""
NO_TRUTH = LabelledScene((), (), (), np.array((0.0, 0.0, 1.0)), np.zeros((0, 3), np.float32), np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A method's objects, compared with the truth.

    fixed: in the world of the true poses, into which the run's world is moved as a whole. carried: in the run's world,
    into which each true object is moved by the frames that see it. iou_2d: (true, found) in each view, in the fixed
    world.
    """

    fixed: Judged
    carried: Judged
    iou_2d: list[NDArray[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRun:
    """Results and cost of a run, and the peer's results on the same frames and poses.

    ate: absolute trajectory error of the tracked poses, root mean square, metres, NaN without true poses; lost: share
    of the frames without a pose. updates: the objects of each update, in order of time, in the world of the true poses.
    step_s: seconds of each stage for each of its frames, without the first frame (it loads kernels).
    """

    ours: Measured
    peer: Measured
    ate: float
    lost: float
    updates: list[Update]
    step_s: dict[str, list[float]]
    frames: int

    def frame_ms(self) -> float:
        """Mean time of all stages per frame, without reading. Object updates are averaged over all frames."""
        total = sum(sum(times) for stage, times in self.step_s.items() if stage != "source")
        return 1e3 * total / max(1, self.frames - 1)


class Runs:
    """Runs the method once for each sequence and settings, so that tables share runs."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._done: dict[tuple[str, tuple[int, int], int, str], MeasuredRun] = {}

    def run(self, item: LabelledSequence, settings: Settings) -> MeasuredRun:
        """The run of this sequence with these settings; see `measure`."""
        key = (item.name, item.sequence.intrinsics.shape, len(item.sequence), settings.model_dump_json())
        if key not in self._done:
            self._say(f"{item.name}, {item.sequence.intrinsics.width} px, {len(item.sequence)} frames ...")
            self._done[key] = measure(item, settings)
        return self._done[key]


def measure(item: LabelledSequence, settings: Settings) -> MeasuredRun:
    """Run the whole method over the sequence and compare its results with the truth.

    With odometry the found world is that of the first pose. It is moved into the true one by the rigid transform that
    agrees best with all true poses (`world_alignment`). Each true object is also moved into the found world by the
    frames that see it (`Sightings`). Raises SourceError if true objects have no true poses to be placed by, and
    StageFailedError if a stage fails on a frame.
    """
    sequence, truth = item.sequence, item.truth or NO_TRUTH
    if item.truth is not None and not sequence.has_true_poses:
        raise SourceError(f"{item.name} has no true poses, which are needed to place its true objects")
    settings = with_poses_there_are(settings, sequence)
    updates: list[list[tuple[int, Box3D]]] = []
    true_of = {stamp: sequence.true_pose(index) for index, stamp in enumerate(sequence.stamps_ns)}
    peer, sightings = PeerMap(len(sequence)), Sightings(truth)

    def follow(step: PipelineStep) -> None:
        if step.objects is not None:
            updates.append([(found.id, found.box) for found in step.objects.objects])
        if step.pose.corrections is not None:
            sightings.correct(step.pose.corrections)
        if step.refused or item.truth is None:
            return
        pose = step.pose
        depth, camera, T_map_camera = as_the_run_has_it(step)
        peer.add(depth, camera, T_map_camera)
        T_true_camera = true_of[step.frame.stamp_ns]
        if T_true_camera is not None:
            sightings.add(depth, camera, T_true_camera, pose.T_world_camera, pose.T_world_map, step.frame.stamp_ns)

    result = run_pipeline(sequence, settings, follow)
    result.failures.refuse()
    tracked = tracked_poses(result)
    known = settings.pose.provider == "given" or item.truth is None
    T = np.eye(4) if known else world_alignment(sequence, tracked)
    pairs = _pairs(sequence, tracked)
    true, estimated = (np.array([pair[which] for pair in pairs]) for which in (0, 1))
    boxes = tuple(found.box for found in result.objects.objects)
    xyz = result.fusion.frequent_points().xyz.astype(np.float64)
    cloud = SortedPoints(xyz)
    ours = Found(boxes, tuple(xyz[cloud.rows_in(box)] for box in boxes))
    carried = sightings.carried(invert(T))
    return MeasuredRun(
        ours=measured(sequence, ours, truth, carried, T),
        peer=measured(sequence, peer.found(settings.fusion).moved(sightings.T_world_map), truth, carried, T),
        ate=ate(true, estimated)["rmse"] if pairs else float("nan"),
        lost=1 - len(tracked) / max(1, len(result.trajectory)),
        updates=[[(number, moved(box, T)) for number, box in update] for update in updates],
        step_s={stage: times[1:] if stage != "objects" else times for stage, times in result.step_s.items()},
        frames=len(sequence),
    )


def as_the_run_has_it(step: PipelineStep) -> tuple[NDArray[np.float32], Intrinsics, NDArray[np.float64]]:
    """Corrected depth (h, w) float32 metres, corrected camera and T_map_camera (4, 4) of a frame, for the peer.

    The map is that of the run's poses, which moves in the run's world (`PoseEstimate.T_world_map`).
    """
    pose, known = step.pose, step.pose.calibration
    T_map_world = np.eye(4) if pose.T_world_map is None else invert(pose.T_world_map)
    depth, camera = known.metres(step.frame.depth_metres()), known.camera(step.frame.intrinsics)
    return depth, camera, T_map_world @ pose.T_world_camera


def tracked_poses(result: PipelineResult) -> list[tuple[int, NDArray[np.float64]]]:
    """Stamps, ns, and (4, 4) T_world_camera of the trusted poses."""
    return [(stamp, pose.T_world_camera) for stamp, pose in result.trajectory if pose.status == "ok"]


def measured(
    sequence: FrameSequence,
    found: Found,
    truth: LabelledScene,
    carried: LabelledScene,
    T_true_found: NDArray[np.float64],
) -> Measured:
    """Compares objects in the run's world with the truth, and with the truth carried into the run's world."""
    fixed = found.moved(T_true_found)
    judged = judge(fixed.boxes, truth)
    counted = set(judged.boxes)
    points = [thinned(p) for box, p in zip(fixed.boxes, fixed.points, strict=True) if box in counted]
    return Measured(judged, judge(found.boxes, carried), views_2d(sequence, truth, points))


def with_poses_there_are(settings: Settings, sequence: FrameSequence) -> Settings:
    """The settings, with KISS-ICP in place of given poses if the sequence has none."""
    if settings.pose.provider != "given" or sequence.has_true_poses:
        return settings
    return settings.changed("pose", provider="kiss")


def world_alignment(sequence: FrameSequence, tracked: Sequence[tuple[int, NDArray[np.float64]]]) -> NDArray[np.float64]:
    """T_true_found (4, 4): mean rotation and shift that align poses with the true ones of the same stamps.

    tracked: stamps and (4, 4) T_world_camera of the trusted poses. The rotation is the mean over all frames (chordal,
    by SVD), so it is well defined for a straight path too. Raises SourceError if no frame has both poses.
    """
    pairs = _pairs(sequence, tracked)
    if not pairs:
        raise SourceError("no frame has both a true pose and a tracked one")
    T = np.eye(4)
    T[:3, :3] = nearest_rotation(np.sum([true[:3, :3] @ found[:3, :3].T for true, found in pairs], axis=0))
    T[:3, 3] = np.mean([true[:3, 3] - T[:3, :3] @ found[:3, 3] for true, found in pairs], axis=0)
    return T


def _pairs(
    sequence: FrameSequence, tracked: Sequence[tuple[int, NDArray[np.float64]]]
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """True and tracked pose, both (4, 4), of each stamp that has both."""
    index_of = {stamp: index for index, stamp in enumerate(sequence.stamps_ns)}
    both = [(sequence.true_pose(index_of[stamp]), pose) for stamp, pose in tracked if stamp in index_of]
    return [(true, found) for true, found in both if true is not None]


def views_2d(
    sequence: FrameSequence, truth: LabelledScene, found: list[NDArray[np.float64]]
) -> list[NDArray[np.float64]]:
    """IoU matrices (true, found) of projections into evenly spread frames. found: world points of each object."""
    true = [
        thinned(points) if len(points := truth.xyz[truth.label == label]) else box_surface(box)
        for label, box in zip(truth.labels, truth.boxes, strict=True)
    ]
    matrices, camera, count = [], sequence.intrinsics, len(sequence)
    for index in range(0, count, max(1, count // VIEWS_2D)):
        pose = sequence.true_pose(index)
        if pose is not None:
            matrices.append(iou_matrix_2d(boxes_in_view(true, pose, camera), boxes_in_view(found, pose, camera)))
    return matrices
