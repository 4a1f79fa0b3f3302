"""One run of the whole method over a labelled sequence, with all that the tables need of it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, iou_matrix_2d, iou_matrix_3d
from spot3d.evaluate.labelled import LabelledSequence
from spot3d.evaluate.points import IGNORED, points_in_boxes
from spot3d.evaluate.projection import box_surface, boxes_in_view, thinned
from spot3d.evaluate.stability import Update
from spot3d.evaluate.truth import LabelledScene
from spot3d.pipeline import PipelineStep, run_pipeline
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.source.sequence import FrameSequence

VIEWS_2D = 50
"""2D overlap is measured in about so many frames, evenly spread."""
HIT = 0.5
"""IoU from which on a found box is a true object's, whatever the labels in it."""
NO_TRUTH = LabelledScene((), (), (), np.array((0.0, 0.0, 1.0)), np.zeros((0, 3), np.float32), np.zeros(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRun:
    """What a run found and cost, in the world of the true poses.

    boxes: the final objects that count; ignored: how many others meet no true object and lie on points that no
    label speaks of.
    updates: the objects of each update, in order of time. iou_3d: (true, found); iou_2d: the same in each of the
    views. step_s: seconds of each stage for each of its frames, the first frame left out (it loads kernels).
    """

    boxes: tuple[Box3D, ...]
    ignored: int
    updates: list[Update]
    iou_3d: NDArray[np.float64]
    iou_2d: list[NDArray[np.float64]]
    step_s: dict[str, list[float]]
    heat_counts: Counter[str]
    skipped: Counter[str]
    frames: int

    def success_of_all(self) -> tuple[int, int]:
        """Found boxes that hit a true one at IoU 0.5, and all found boxes, the ignored ones included."""
        hits = int(np.count_nonzero(self.iou_3d.max(axis=0, initial=0.0) >= HIT))
        return hits, len(self.boxes) + self.ignored

    def frame_ms(self) -> float:
        """Mean time of all stages for a frame, reading it not included; objects count by their share of frames."""
        total = sum(sum(times) for stage, times in self.step_s.items() if stage != "source")
        return 1e3 * total / max(1, self.frames - 1)


class Runs:
    """Runs the method, once for each sequence and settings: tables share runs."""

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
    """Run the whole method over the sequence and compare what it finds with the truth.

    With odometry the found world is that of the first pose: it is moved into the true one by the rigid
    transform that agrees best with all true poses (`world_alignment`). Raises SourceError where true objects
    have no true poses to be placed by.
    """
    truth = item.truth or NO_TRUTH
    if item.truth is not None and not item.sequence.has_true_poses:
        raise SourceError(f"{item.name} has no true poses to place its true objects by")
    settings = with_poses_there_are(settings, item.sequence)
    updates: list[list[tuple[int, Box3D]]] = []

    def follow(step: PipelineStep) -> None:
        if step.objects is not None:
            updates.append([(found.id, found.box) for found in step.objects.objects])

    result = run_pipeline(item.sequence, settings, follow)
    tracked = [(stamp, pose.T_world_camera) for stamp, pose in result.trajectory if pose.status == "ok"]
    known = settings.pose.provider == "given" or not truth.boxes
    T = np.eye(4) if known else world_alignment(item.sequence, tracked)
    found = [moved(found.box, T) for found in result.objects.objects]
    boxes = that_count(found, truth)
    xyz = result.fusion.frequent_points().xyz.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    return MeasuredRun(
        boxes=boxes,
        ignored=len(found) - len(boxes),
        updates=[[(number, moved(box, T)) for number, box in update] for update in updates],
        iou_3d=iou_matrix_3d(truth.boxes, boxes),
        iou_2d=views_2d(item.sequence, truth, [thinned(xyz[points_in_boxes(xyz, [box])]) for box in boxes]),
        step_s={stage: times[1:] if stage != "objects" else times for stage, times in result.step_s.items()},
        heat_counts=result.heat_counts,
        skipped=result.skipped,
        frames=len(item.sequence),
    )


def with_poses_there_are(settings: Settings, sequence: FrameSequence) -> Settings:
    """The same settings, but KISS-ICP where they ask for given poses and the sequence has none."""
    if settings.pose.provider != "given" or sequence.has_true_poses:
        return settings
    return settings.model_copy(update={"pose": settings.pose.model_copy(update={"provider": "kiss"})})


def moved(box: Box3D, T_target_source: NDArray[np.float64]) -> Box3D:
    """The box in another frame."""
    R = T_target_source[:3, :3]
    return Box3D(R @ box.centre + T_target_source[:3, 3], box.size, R @ box.rotation)


def that_count(found: Sequence[Box3D], truth: LabelledScene) -> tuple[Box3D, ...]:
    """The boxes that hit a true object, or lie where the labels tell that there is none."""
    hits = iou_matrix_3d(truth.boxes, found).max(axis=0, initial=0.0) >= HIT
    return tuple(box for box, hit in zip(found, hits, strict=True) if hit or not on_ignored(box, truth))


def on_ignored(box: Box3D, truth: LabelledScene) -> bool:
    """Whether most labelled points in the box are ignored ones: nothing tells whether an object is there."""
    inside = truth.label[points_in_boxes(truth.xyz, [box])]
    return bool(np.count_nonzero(inside == IGNORED) > len(inside) / 2)


def world_alignment(sequence: FrameSequence, tracked: Sequence[tuple[int, NDArray[np.float64]]]) -> NDArray[np.float64]:
    """T_true_found (4, 4): mean rotation and shift that bring poses onto the true ones of the same stamps.

    tracked: stamps and (4, 4) T_world_camera of the trusted poses. The rotation is the mean of all frames' (chordal, by
    SVD), so it is well defined for a straight path too. Raises SourceError where no frame has both poses.
    """
    index_of = {stamp: index for index, stamp in enumerate(sequence.stamps_ns)}
    both = [(sequence.true_pose(index_of[stamp]), pose) for stamp, pose in tracked if stamp in index_of]
    pairs = [(true, found) for true, found in both if true is not None]
    if not pairs:
        raise SourceError("no frame has both a true pose and a tracked one")
    u, _, vt = np.linalg.svd(np.sum([true[:3, :3] @ found[:3, :3].T for true, found in pairs], axis=0))
    T = np.eye(4)
    T[:3, :3] = u @ np.diag((1.0, 1.0, np.linalg.det(u @ vt))) @ vt
    T[:3, 3] = np.mean([true[:3, 3] - T[:3, :3] @ found[:3, 3] for true, found in pairs], axis=0)
    return T


def views_2d(
    sequence: FrameSequence, truth: LabelledScene, found: list[NDArray[np.float64]]
) -> list[NDArray[np.float64]]:
    """IoU matrices (true, found) of the projections in evenly spread frames; found: world points of each object."""
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
