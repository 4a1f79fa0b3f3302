"""Recall over IoU as a picture (paper, Fig. 12), drawn with OpenCV."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from spot3d.drawing.overview import write_picture
from spot3d.drawing.picture import Picture
from spot3d.evaluate.table import Curve, Table

SIZE = (900, 600)
LEFT, TOP, RIGHT, BOTTOM = 90, 60, 290, 80
INK, GRID, PAPER = (40, 40, 40), (222, 222, 222), (255, 255, 255)
# Okabe and Ito's colours, told apart by colour-blind readers too (RGB).
COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0), (0, 0, 0))
SUBPIXEL_BITS = 4


def recall_plot(title: str, curves: Sequence[Curve]) -> Picture:
    """Recall (0 to 1) over IoU thresholds (0 to 1) of each curve, with a legend; (600, 900, 3) uint8 RGB.

    Curves over named levels have these along the axis instead.
    """
    picture: Picture = np.full((SIZE[1], SIZE[0], 3), PAPER, np.uint8)
    width, height = SIZE[0] - LEFT - RIGHT, SIZE[1] - TOP - BOTTOM

    def place(iou: float, recall: float) -> tuple[int, int]:
        return round(LEFT + iou * width), round(TOP + (1 - recall) * height)

    levels = next((curve.levels for curve in curves if curve.levels), ())
    for step in np.linspace(0, 1, 6):
        cv2.line(picture, place(0, step), place(1, step), GRID, 1)
        _write(picture, f"{step:.1f}", (LEFT - 40, place(0, step)[1] + 5), 0.45)
    ticks = levels or tuple(f"{step:.1f}" for step in np.linspace(0, 1, 6))
    for step, text in zip(np.linspace(0, 1, len(ticks)), ticks, strict=True):
        cv2.line(picture, place(step, 0), place(step, 1), GRID, 1)
        _write(picture, text, (place(step, 0)[0] - round(3.7 * len(text)), SIZE[1] - BOTTOM + 24), 0.45)
    cv2.rectangle(picture, place(0, 1), place(1, 0), INK, 1)
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        # More curves than colours: those of the next round are thin.
        thickness = 3 if number < len(COLOURS) else 1
        known = np.isfinite(curve.recall)
        x = LEFT + curve.thresholds[known] * width
        y = TOP + (1 - curve.recall[known]) * height
        points = np.rint(np.stack((x, y), axis=1) * (1 << SUBPIXEL_BITS)).astype(np.int32)
        cv2.polylines(picture, [points], False, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)
        row = TOP + 16 + 26 * number
        cv2.line(
            picture, (SIZE[0] - RIGHT + 18, row - 5), (SIZE[0] - RIGHT + 46, row - 5), colour, thickness, cv2.LINE_AA
        )
        _write(picture, curve.name, (SIZE[0] - RIGHT + 54, row), 0.45)
    _write(picture, title, (LEFT, TOP - 22), 0.55)
    if not levels:
        _write(picture, "IoU threshold", (LEFT + width // 2 - 55, SIZE[1] - 22), 0.5)
    _write(picture, "rate" if levels else "recall", (12, TOP - 22), 0.5)
    return picture


def write_plots(folder: Path, tables: Sequence[Table]) -> None:
    """Write a plot TABLE-DATA.png for each data set of each table with curves. Raises OSError where that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        for data in dict.fromkeys(curve.data for curve in table.curves):
            picture = recall_plot(f"{data}: {table.title}", [curve for curve in table.curves if curve.data == data])
            write_picture(folder / f"{table.name}-{data.replace(':', '-').replace(' ', '-')}.png", picture)


def _write(picture: Picture, text: str, at: tuple[int, int], scale: float) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, INK, 1, cv2.LINE_AA)
