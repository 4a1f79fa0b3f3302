"""Scores of found boxes against true ones (paper, Sec. VI-A and Table III)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import detection_rate, mean_iou, mean_modified_iou, recall_curve, success_rate
from spot3d.drawing.charts import Curve

THRESHOLDS = np.linspace(0, 1, 41)
HIT = 0.5
"""Least IoU at which a found box is a true object's."""
MEETS = 0.25
"""A found box whose IoU with every true object is below this is none of them, not even a badly boxed one."""


class ObjectScores(NamedTuple):
    """Mean IoU over true objects, mean modified IoU over found ones, success and detection rate at 0.5.

    In the order of the paper's Table III.
    """

    iou: float
    iou_modified: float
    success: float
    detection: float


def object_scores(scenes: Sequence[NDArray[np.float64]]) -> ObjectScores:
    """Scores from IoU matrices (true, found), one for each scene or view. nan where nothing can be counted."""
    return ObjectScores(mean_iou(scenes), mean_modified_iou(scenes), success_rate(scenes), detection_rate(scenes))


def recall_of(data: str, name: str, scenes: Sequence[NDArray[np.float64]]) -> Curve:
    """The recall curve of a data set's IoU matrices over thresholds 0 to 1."""
    return Curve(data, name, THRESHOLDS, recall_curve(scenes, THRESHOLDS))


def without_object(scenes: Sequence[NDArray[np.float64]]) -> float:
    """Mean number of found boxes of a scene or frame that are no true object (IoU below 0.25). nan without scenes.

    scenes: IoU matrices (true, found).
    """
    strays = [np.count_nonzero(iou.max(axis=0, initial=0.0) < MEETS) for iou in scenes]
    return float(np.mean(strays)) if strays else float("nan")
