"""Point-wise precision, recall and F-measure of 3D boxes against a labelled cloud (paper, Sec. VI-B)."""

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D

BACKGROUND = 0
IGNORED = 255
# Slack in metres, so that rounding loses no point on a surface.
ROUNDING = 1e-6


class PointScores(NamedTuple):
    """Precision, recall and F-measure in percent; nan where undefined (nothing to divide by)."""

    precision: float
    recall: float
    f_measure: float


class SortedPoints:
    """(N, 3) points, metres, sorted along x once, so that each box tests only a contiguous range of them."""

    def __init__(self, xyz: NDArray[np.floating]) -> None:
        if xyz.ndim != 2 or xyz.shape[1] != 3:
            raise ValueError(f"points must be (N, 3), got shape {xyz.shape}")
        self._order = np.argsort(xyz[:, 0])
        self._xyz = np.ascontiguousarray(xyz[self._order].T, dtype=np.float64)

    def rows_in(self, box: Box3D) -> NDArray[np.int64]:
        """Rows of the points in the box, its surface included. Points that are not finite are in no box."""
        half, x = box.size / 2, self._xyz[0]
        low, high = box.centre[0] + np.array((-1, 1)) * (np.abs(box.rotation[0]) @ half + ROUNDING)
        stretch = slice(np.searchsorted(x, low), np.searchsorted(x, high))
        offset = self._xyz[:, stretch] - box.centre[:, None]
        inside = (np.abs(box.rotation.T @ offset) <= half[:, None] + ROUNDING).all(axis=0)
        return np.asarray(self._order[stretch][inside])


def points_in_boxes(xyz: NDArray[np.floating], boxes: Sequence[Box3D]) -> NDArray[np.bool_]:
    """Which points lie in at least one box, its surface included.

    xyz: (N, 3) metres, in the boxes' frame; points that are not finite are in no box. Returns (N,) bool.
    """
    points, inside = SortedPoints(xyz), np.zeros(len(xyz), dtype=np.bool_)
    for box in boxes:
        inside[points.rows_in(box)] = True
    return inside


def point_scores(xyz: NDArray[np.floating], label: NDArray[np.integer], boxes: Sequence[Box3D]) -> PointScores:
    """AP, AR and F of one scene's proposals, in percent (paper, Sec. VI-B, TP and FP).

    xyz: (N, 3) metres, in the boxes' frame. label: (N,) integers: 0 background (redundant points),
    255 ignored, all others points of interest. A point counts once, however many boxes hold it.
    Precision is nan when the boxes hold no labelled point, recall when there is no point of interest; F is
    2 TP / (2 TP + FP + FN), so 0 and not nan when nothing is proposed where there is something to find.
    """
    if label.shape != (len(xyz),):
        raise ValueError(f"one label per point: {len(xyz)} points, labels of shape {label.shape}")
    inside = points_in_boxes(xyz, boxes)
    of_interest = (label != BACKGROUND) & (label != IGNORED)
    true_positive = int(np.count_nonzero(inside & of_interest))
    false_positive = int(np.count_nonzero(inside & (label == BACKGROUND)))
    missed = int(np.count_nonzero(of_interest)) - true_positive
    return PointScores(
        precision=_percent(true_positive, true_positive + false_positive),
        recall=_percent(true_positive, true_positive + missed),
        f_measure=_percent(2 * true_positive, 2 * true_positive + false_positive + missed),
    )


def mean_point_scores(scenes: Sequence[PointScores]) -> PointScores:
    """Average over scenes: mean precision, mean recall, and the F-measure of these means (paper, Table IV).

    A scene whose value is undefined is left out of that mean; nan when none is left.
    """
    precision = _mean_defined([scene.precision for scene in scenes])
    recall = _mean_defined([scene.recall for scene in scenes])
    total = precision + recall
    return PointScores(precision, recall, 2 * precision * recall / total if total else 0.0)


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else nan


def _mean_defined(values: Sequence[float]) -> float:
    defined = [value for value in values if not np.isnan(value)]
    return float(np.mean(defined)) if defined else nan
