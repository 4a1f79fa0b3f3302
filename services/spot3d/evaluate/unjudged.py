"""Found boxes in images that are annotated only in part."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import iou_matrix_2d
from spot3d.evaluate.labelled import LabelledFrame
from spot3d.evaluate.scores import HIT


def judged_overlap(item: LabelledFrame, found: NDArray[np.floating]) -> tuple[NDArray[np.float64], int]:
    """IoU (true, counted) of the found boxes (m, 4 or more) that count, and how many are left out.

    Left out are boxes that hit no true object and have more than half of their pixels where nothing is annotated.
    """
    iou = iou_matrix_2d(item.boxes, found)
    if item.unjudged is None or not len(found):
        return iou, 0
    stray = iou.max(axis=0, initial=0.0) < HIT
    counts = ~(stray & (_share(item.unjudged, found[:, :4].astype(np.float64)) > 0.5))
    return iou[:, counts], int(np.count_nonzero(~counts))


def _share(mask: NDArray[np.bool_], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share (m,) of each box's pixels (m, 4) [x, y, w, h] that are set in an (h, w) mask."""
    sums = np.asarray(cv2.integral(mask.astype(np.uint8)), np.int64)
    height, width = mask.shape
    low = np.clip(np.rint(boxes[:, :2]).astype(np.int64), 0, (width, height))
    high = np.clip(np.rint(boxes[:, :2] + boxes[:, 2:]).astype(np.int64), 0, (width, height))
    (left, top), (right, bottom) = low.T, high.T
    inside = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return np.asarray(inside / np.maximum(1, (right - left) * (bottom - top)))
