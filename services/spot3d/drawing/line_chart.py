"""Small line charts, drawn with OpenCV."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.picture import Picture

SIZE = (900, 600)
LEFT, TOP, RIGHT, BOTTOM = 90, 60, 290, 80
INK, GRID, _PAPER = (40, 40, 40), (222, 222, 222), (255, 255, 255)
# Okabe and Ito's colours, which colour-blind readers can distinguish (RGB).
_COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0), (0, 0, 0))
_SUBPIXEL_BITS = 4
_TICKS = 5


@dataclass(frozen=True, slots=True)
class Line:
    """A named line through points (x, y)."""

    name: str
    points: Sequence[tuple[float, float]]


def line_chart(title: str, x_name: str, y_name: str, lines: Sequence[Line]) -> Picture:
    """The lines over axes that start at zero, with a legend; (600, 900, 3) uint8 RGB.

    Points that are not finite are left out.
    """
    picture = empty_chart()
    curves = [np.array(line.points, np.float64).reshape(-1, 2) for line in lines]
    curves = [points[np.isfinite(points).all(axis=1)] for points in curves]
    width, height = SIZE[0] - LEFT - RIGHT, SIZE[1] - TOP - BOTTOM
    x_step, y_step = (_tick(max((float(p[axis]) for points in curves for p in points), default=1.0)) for axis in (0, 1))
    bottom = SIZE[1] - BOTTOM
    for tick in range(_TICKS + 1):
        x, y = LEFT + width * tick // _TICKS, bottom - height * tick // _TICKS
        cv2.line(picture, (x, TOP), (x, bottom), GRID, 1)
        cv2.line(picture, (LEFT, y), (SIZE[0] - RIGHT, y), GRID, 1)
        write_text(picture, f"{tick * x_step:g}", (x - 16, bottom + 24))
        write_text(picture, f"{tick * y_step:g}", (LEFT - 58, y + 5))
    for number, (line, curve) in enumerate(zip(lines, curves, strict=True)):
        scale = np.array([width / (_TICKS * x_step), -height / (_TICKS * y_step)])
        points = np.array([LEFT, bottom]) + curve * scale
        draw_curve(picture, number, line.name, points)
    write_text(picture, title, (LEFT, TOP - 22))
    write_text(picture, x_name, (LEFT + width // 2 - 50, SIZE[1] - 22))
    write_text(picture, y_name, (12, TOP - 22))
    return picture


def _tick(most: float) -> float:
    """A round step between ticks, with which `_TICKS` steps reach at least `most`."""
    least = max(most, 1e-9) / _TICKS
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * digit for digit in (1, 2, 2.5, 5, 10) if power * digit >= least * (1 - 1e-9)))


def empty_chart() -> Picture:
    """An empty picture for a chart: (600, 900, 3) uint8 RGB."""
    return np.full((SIZE[1], SIZE[0], 3), _PAPER, np.uint8)


def draw_curve(picture: Picture, number: int, name: str, points: NDArray[np.float64]) -> None:
    """Draw the line through the pixels (n, 2) and its name in the legend, in place; `number` counts from 0."""
    colour = _COLOURS[number % len(_COLOURS)]
    # Lines beyond the number of colours reuse them, and are thin.
    thickness = 3 if number < len(_COLOURS) else 1
    fixed = np.rint(points * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    cv2.polylines(picture, [fixed], False, colour, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)
    left, row = SIZE[0] - RIGHT, TOP + 16 + 26 * number
    cv2.line(picture, (left + 18, row - 5), (left + 46, row - 5), colour, thickness, cv2.LINE_AA)
    write_text(picture, name, (left + 54, row))


def write_text(picture: Picture, text: str, at: tuple[int, int], scale: float = 0.45) -> None:
    """Write text with its lower left corner at `at`, in place."""
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, INK, 1, cv2.LINE_AA)
