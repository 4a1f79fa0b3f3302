"""Scores of found boxes against true ones (paper, Sec. VI-A and Table III)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.charts import Curve

THRESHOLDS = np.linspace(0, 1, 41)
HIT = 0.5
"""Least IoU at which a found box is a true object's."""
MEETS = 0.25
"""A found box whose IoU with every true object is below this is none of them, not even a badly boxed one."""


class ObjectScores(NamedTuple):
    """Mean IoU over true objects, mean modified IoU over found ones, success and detection rate at IoU 0.5.

    In the order of the paper's Table III; nan where nothing can be counted.
    """

    iou: float
    iou_modified: float
    success: float
    detection: float


def object_scores(scenes: Sequence[NDArray[np.float64]]) -> ObjectScores:
    """Scores from IoU matrices (true, found), one for each scene or view (paper, Sec. VI-A).

    IoU and detection rate: by the best overlap of each true object with a found box; modified IoU and success rate: of
    each found box with a true object. The paper divides by N * K, as if each scene had N objects; here all scenes'
    objects are pooled, as are their boxes: the same for equal N.
    """
    of_true, of_found = _best(scenes, 1), _best(scenes, 0)
    return ObjectScores(_mean(of_true), _mean(of_found), _mean(of_found >= HIT), _mean(of_true >= HIT))


def recall_of(data: str, name: str, scenes: Sequence[NDArray[np.float64]]) -> Curve:
    """The recall curve of a data set's IoU matrices: the detection rate at thresholds 0 to 1 (paper, Fig. 10)."""
    best = _best(scenes, 1)
    return Curve(data, name, THRESHOLDS, np.array([_mean(best >= threshold) for threshold in THRESHOLDS]))


def without_object(scenes: Sequence[NDArray[np.float64]]) -> float:
    """Mean number of found boxes of a scene or frame that are no true object (IoU below 0.25). nan without scenes.

    scenes: IoU matrices (true, found).
    """
    strays = [np.count_nonzero(iou.max(axis=0, initial=0.0) < MEETS) for iou in scenes]
    return float(np.mean(strays)) if strays else float("nan")


def _best(scenes: Sequence[NDArray[np.float64]], axis: int) -> NDArray[np.float64]:
    """The largest IoU along this axis of all matrices; 0 where it has no entries."""
    return np.concatenate([np.zeros(0), *(iou.max(axis=axis, initial=0.0) for iou in scenes)])


def _mean(values: NDArray[np.float64] | NDArray[np.bool_]) -> float:
    return float(np.mean(values)) if values.size else float("nan")
