"""Found boxes beside true ones: which of them count, how well they fit, which points they hold."""

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
    """What a method found: boxes, and the (n, 3) float64 points of each, in one world."""

    boxes: tuple[Box3D, ...]
    points: tuple[NDArray[np.float64], ...]

    def moved(self, T_target_source: NDArray[np.float64]) -> "Found":
        """The same in another world."""
        R, t = T_target_source[:3, :3], T_target_source[:3, 3]
        points = tuple(points @ R.T + t for points in self.points)
        return Found(tuple(moved(box, T_target_source) for box in self.boxes), points)


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Boxes beside the truth of the same world.

    boxes: those that count; left_out: how many others meet no true object and lie on points that no label speaks of.
    iou: (true, counted) float64. points: of the boxes that count; points_of_all: of the others as well.
    """

    boxes: tuple[Box3D, ...]
    left_out: int
    iou: NDArray[np.float64]
    points: PointScores
    points_of_all: PointScores

    def success_of_all(self) -> tuple[int, int]:
        """Found boxes that hit a true one at IoU 0.5, and all found boxes, those left out included."""
        hits = int(np.count_nonzero(self.iou.max(axis=0, initial=0.0) >= HIT))
        return hits, len(self.boxes) + self.left_out


def judge(found: Sequence[Box3D], truth: LabelledScene) -> Judged:
    """The found boxes, in the world of the truth, beside it (paper, Sec. VI)."""
    boxes = that_count(found, truth)
    scores = [point_scores(truth.xyz, truth.label, chosen) for chosen in (boxes, found)]
    return Judged(boxes, len(found) - len(boxes), iou_matrix_3d(truth.boxes, boxes), *scores)


def that_count(found: Sequence[Box3D], truth: LabelledScene) -> tuple[Box3D, ...]:
    """The boxes that meet a true object, or lie where the labels tell that there is none.

    Where most labelled points in a box are ignored ones, nothing tells whether an object is there.
    """
    meets = iou_matrix_3d(truth.boxes, found).max(axis=0, initial=0.0) >= MEETS
    points = SortedPoints(truth.xyz)

    def on_ignored(box: Box3D) -> bool:
        inside = truth.label[points.rows_in(box)]
        return bool(np.count_nonzero(inside == IGNORED) > len(inside) / 2)

    return tuple(box for box, met in zip(found, meets, strict=True) if met or not on_ignored(box))
