"""Chart of recall over IoU (paper, Fig. 10), drawn with OpenCV."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.line_chart import BOTTOM, GRID, INK, LEFT, RIGHT, SIZE, TOP, draw_curve, empty_chart, write_text
from spot3d.drawing.picture import Picture


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A curve of one data set: recall (t,) over the IoU thresholds (t,).

    levels: names, if the curve is another rate over named levels, whose places along the axis are in `thresholds`.
    """

    data: str
    name: str
    thresholds: NDArray[np.float64]
    recall: NDArray[np.float64]
    levels: tuple[str, ...] = ()


def recall_plot(title: str, curves: Sequence[Curve]) -> Picture:
    """Recall (0 to 1) over IoU thresholds (0 to 1) of each curve, with a legend; (600, 900, 3) uint8 RGB.

    Curves over named levels have these along the axis instead.
    """
    picture = empty_chart()
    width, height = SIZE[0] - LEFT - RIGHT, SIZE[1] - TOP - BOTTOM

    def place(iou: float, recall: float) -> tuple[int, int]:
        return round(LEFT + iou * width), round(TOP + (1 - recall) * height)

    levels = next((curve.levels for curve in curves if curve.levels), ())
    for step in np.linspace(0, 1, 6):
        cv2.line(picture, place(0, step), place(1, step), GRID, 1)
        write_text(picture, f"{step:.1f}", (LEFT - 40, place(0, step)[1] + 5))
    ticks = levels or tuple(f"{step:.1f}" for step in np.linspace(0, 1, 6))
    for step, text in zip(np.linspace(0, 1, len(ticks)), ticks, strict=True):
        cv2.line(picture, place(step, 0), place(step, 1), GRID, 1)
        write_text(picture, text, (place(step, 0)[0] - round(3.7 * len(text)), SIZE[1] - BOTTOM + 24))
    cv2.rectangle(picture, place(0, 1), place(1, 0), INK, 1)
    for number, curve in enumerate(curves):
        known = np.isfinite(curve.recall)
        x = LEFT + curve.thresholds[known] * width
        y = TOP + (1 - curve.recall[known]) * height
        draw_curve(picture, number, curve.name, np.stack((x, y), axis=1))
    write_text(picture, title, (LEFT, TOP - 22), 0.55)
    if not levels:
        write_text(picture, "IoU threshold", (LEFT + width // 2 - 55, SIZE[1] - 22), 0.5)
    write_text(picture, "rate" if levels else "recall", (12, TOP - 22), 0.5)
    return picture
