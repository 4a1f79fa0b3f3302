"""Line charts, drawn with OpenCV: of measured values, and of recall over IoU (paper, Fig. 10)."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.picture import Picture

_SIZE = (900, 600)
_LEFT, _TOP, _WIDTH, _HEIGHT = 90, 60, 520, 460
"""The axes' place in the picture; the legend is to the right of it."""
_INK, _GRID, _PAPER = (40, 40, 40), (222, 222, 222), (255, 255, 255)
# Okabe and Ito's colours, which colour-blind readers can distinguish (RGB).
_COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0), (0, 0, 0))
_SUBPIXEL_BITS = 4
_TICKS = 5


@dataclass(frozen=True, slots=True)
class Line:
    """A named line through points (x, y)."""

    name: str
    points: Sequence[tuple[float, float]]


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


def line_chart(title: str, x_name: str, y_name: str, lines: Sequence[Line]) -> Picture:
    """The lines over axes that start at zero, with a legend; (600, 900, 3) uint8 RGB.

    Points that are not finite are left out.
    """
    curves = [np.array(line.points, np.float64).reshape(-1, 2) for line in lines]
    curves = [points[np.isfinite(points).all(axis=1)] for points in curves]
    steps = [_tick(max((float(p[axis]) for points in curves for p in points), default=1.0)) for axis in (0, 1)]
    x_ticks, y_ticks = ([f"{tick * step:g}" for tick in range(_TICKS + 1)] for step in steps)
    picture = _axes(title, x_name, y_name, x_ticks, y_ticks)
    for number, (line, points) in enumerate(zip(lines, curves, strict=True)):
        _draw_curve(picture, number, line.name, points / (_TICKS * np.array(steps)))
    return picture


def recall_plot(title: str, curves: Sequence[Curve]) -> Picture:
    """Recall (0 to 1) over IoU thresholds (0 to 1) of each curve, with a legend; (600, 900, 3) uint8 RGB.

    Curves over named levels have these along the axis instead. What is not known is not drawn.
    """
    levels = next((curve.levels for curve in curves if curve.levels), ())
    shares = [f"{tick / _TICKS:.1f}" for tick in range(_TICKS + 1)]
    x_name, y_name = ("", "rate") if levels else ("IoU threshold", "recall")
    picture = _axes(title, x_name, y_name, levels or shares, shares)
    for number, curve in enumerate(curves):
        points = np.column_stack((curve.thresholds, curve.recall))
        _draw_curve(picture, number, curve.name, points[np.isfinite(curve.recall)])
    return picture


def _tick(most: float) -> float:
    """A round step between ticks, with which `_TICKS` steps reach at least `most`."""
    least = max(most, 1e-9) / _TICKS
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * digit for digit in (1, 2, 2.5, 5, 10) if power * digit >= least * (1 - 1e-9)))


def _axes(title: str, x_name: str, y_name: str, x_ticks: Sequence[str], y_ticks: Sequence[str]) -> Picture:
    """A chart without curves: a grid whose lines are labelled from left to right and from the bottom up."""
    picture: Picture = np.full((_SIZE[1], _SIZE[0], 3), _PAPER, np.uint8)
    right, bottom = _LEFT + _WIDTH, _TOP + _HEIGHT
    for x, text in zip(np.rint(np.linspace(_LEFT, right, len(x_ticks))).astype(int).tolist(), x_ticks, strict=True):
        cv2.line(picture, (x, _TOP), (x, bottom), _GRID, 1)
        _write(picture, text, (x - round(3.7 * len(text)), bottom + 24))
    for y, text in zip(np.rint(np.linspace(bottom, _TOP, len(y_ticks))).astype(int).tolist(), y_ticks, strict=True):
        cv2.line(picture, (_LEFT, y), (right, y), _GRID, 1)
        _write(picture, text, (_LEFT - 12 - 8 * len(text), y + 5))
    _write(picture, title, (_LEFT, _TOP - 22))
    _write(picture, x_name, (_LEFT + _WIDTH // 2 - 50, _SIZE[1] - 22))
    _write(picture, y_name, (12, _TOP - 22))
    return picture


def _draw_curve(picture: Picture, number: int, name: str, points: NDArray[np.float64]) -> None:
    """Draw the line through points (n, 2) in shares of the axes, and its name in the legend; `number` counts from 0."""
    colour = _COLOURS[number % len(_COLOURS)]
    # Lines beyond the number of colours reuse them, and are thin.
    thickness = 3 if number < len(_COLOURS) else 1
    pixels = (_LEFT, _TOP + _HEIGHT) + points * (_WIDTH, -_HEIGHT)
    fixed = np.rint(pixels * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    cv2.polylines(picture, [fixed], False, colour, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)
    left, row = _LEFT + _WIDTH, _TOP + 16 + 26 * number
    cv2.line(picture, (left + 18, row - 5), (left + 46, row - 5), colour, thickness, cv2.LINE_AA)
    _write(picture, name, (left + 54, row))


def _write(picture: Picture, text: str, at: tuple[int, int]) -> None:
    """Write text with its lower left corner at `at`, in place."""
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
