"""Compares found boxes with true ones: which of them count, how well they fit, which points they contain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, iou_matrix_3d, moved
from spot3d.evaluate.points import IGNORED, PointScores, SortedPoints, point_scores
from spot3d.evaluate.scores import HIT, MEETS
from spot3d.evaluate.truth import LabelledScene


@dataclass(frozen=True, slots=True)
class Found:
    """A method's boxes, and the (n, 3) float64 points of each, in one world."""

    boxes: tuple[Box3D, ...]
    points: tuple[NDArray[np.float64], ...]

    def moved(self, T_target_source: NDArray[np.float64]) -> "Found":
        """The same objects in another world."""
        R, t = T_target_source[:3, :3], T_target_source[:3, 3]
        points = tuple(points @ R.T + t for points in self.points)
        return Found(tuple(moved(box, T_target_source) for box in self.boxes), points)


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Found boxes compared with the truth in the same world.

    boxes: those that count; left_out: number of the others, which overlap no true object and lie on unlabelled points.
    iou: (true, counted) float64. points: scores of the boxes that count; points_of_all: scores of all boxes.
    """

    boxes: tuple[Box3D, ...]
    left_out: int
    iou: NDArray[np.float64]
    points: PointScores
    points_of_all: PointScores

    def success_of_all(self) -> tuple[int, int]:
        """Number of found boxes that hit a true one at IoU 0.5, and of all found boxes, those left out included."""
        hits = int(np.count_nonzero(self.iou.max(axis=0, initial=0.0) >= HIT))
        return hits, len(self.boxes) + self.left_out


def judge(found: Sequence[Box3D], truth: LabelledScene) -> Judged:
    """Compares found boxes with the truth in the same world (paper, Sec. VI)."""
    boxes = that_count(found, truth)
    scores = [point_scores(truth.xyz, truth.label, chosen) for chosen in (boxes, found)]
    return Judged(boxes, len(found) - len(boxes), iou_matrix_3d(truth.boxes, boxes), *scores)


def that_count(found: Sequence[Box3D], truth: LabelledScene) -> tuple[Box3D, ...]:
    """The boxes that overlap a true object, or lie where the labels say that there is none.

    If most labelled points in a box are ignored ones, it is unknown whether an object is there.
    """
    meets = iou_matrix_3d(truth.boxes, found).max(axis=0, initial=0.0) >= MEETS
    points = SortedPoints(truth.xyz)

    def on_ignored(box: Box3D) -> bool:
        inside = truth.label[points.rows_in(box)]
        return bool(np.count_nonzero(inside == IGNORED) > len(inside) / 2)

    return tuple(box for box, met in zip(found, meets, strict=True) if met or not on_ignored(box))
