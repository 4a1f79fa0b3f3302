"""Colours, lines and labels of pictures, and PNG files."""

import colorsys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.whole_file import whole_file

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]
Point = tuple[float, float]

INK: Colour = (18, 20, 24)
WHITE: Colour = (245, 246, 248)
GREY: Colour = (150, 156, 166)

_FONT = cv2.FONT_HERSHEY_DUPLEX
_SUBPIXEL_BITS = 4

# Bright hues, with neighbours in this order far apart; an object has the same in every view.
_PALETTE: tuple[Colour, ...] = (
    (255, 92, 92),
    (64, 196, 255),
    (255, 214, 64),
    (122, 230, 110),
    (255, 128, 222),
    (255, 160, 64),
    (120, 140, 255),
    (64, 232, 206),
    (200, 120, 255),
    (206, 232, 80),
    (255, 150, 140),
    (150, 210, 255),
)


def object_colour(number: int) -> Colour:
    """A bright colour for an object's id (from 1 on), distinct from its neighbours' colours."""
    if 1 <= number <= len(_PALETTE):
        return _PALETTE[number - 1]
    hue = (number * 0.618034) % 1.0
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.55, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


def draw_lines(picture: Picture, lines: NDArray[np.float64], colour: Colour, thickness: int) -> None:
    """Draw (n, 2, 2) line segments [from, to][x, y] with a dark outline, in place."""
    ends = _fixed(lines)
    for outline, paint in ((2, INK), (0, colour)):
        cv2.polylines(picture, ends, False, paint, thickness + outline, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_faint_lines(picture: Picture, lines: NDArray[np.float64], colour: Colour) -> None:
    """Draw (n, 2, 2) line segments thin and half transparent, in place: for hidden edges."""
    layer = picture.copy()
    cv2.polylines(layer, _fixed(lines), False, colour, 1, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.addWeighted(layer, 0.5, picture, 0.5, 0, dst=picture)


def draw_text(
    picture: Picture, text: str, at: Point, colour: Colour = WHITE, scale: float = 0.5, tag: bool = False
) -> None:
    """Write text with its lower left corner at `at`, in place; `tag` puts a dark plate behind it.

    OpenCV's fonts have only ASCII, and it crashes on text that is not valid UTF-8: other characters are shown as `?`.
    """
    text = text.encode("ascii", "replace").decode()
    left, bottom = round(at[0]), round(at[1])
    if tag:
        right, top = left + text_width(text, scale), bottom - round(22 * scale)
        cv2.rectangle(picture, (left - 4, top - 4), (right + 3, bottom + 4), INK, -1)
    cv2.putText(picture, text, (left, bottom), _FONT, scale, colour, 1, cv2.LINE_AA)


def text_width(text: str, scale: float = 0.5) -> int:
    """Width in pixels of what `draw_text` writes."""
    return int(cv2.getTextSize(text, _FONT, scale, 1)[0][0])


def place_labels(wanted: list[Point], widths: list[int], height: int, shape: tuple[int, ...]) -> list[Point]:
    """Lower left corners of labels centred on the wanted points, moved up or down until none overlap.

    shape: (h, w, ...) of the picture that they must stay in.
    """
    placed: list[tuple[float, float, int]] = []
    for (x, y), width in zip(wanted, widths, strict=True):
        left = min(max(x - width / 2, 2), shape[1] - width - 2)
        tries = (y + sign * step * height / 2 for step in range(40) for sign in (-1, 1))
        inside = [bottom for bottom in tries if height <= bottom <= shape[0] - 2]
        free = (b for b in inside if not any(_overlap((left, b, width), other, height) for other in placed))
        placed.append((left, next(free, min(max(y, height), shape[0] - 2)), width))
    return [(left, bottom) for left, bottom, _ in placed]


def draw_object_labels(picture: Picture, labels: list[tuple[int, Point]]) -> None:
    """Write the ids of objects near the wanted points, in their colours, without overlap, in place."""
    widths = [text_width(str(number), 0.6) for number, _ in labels]
    places = place_labels([wanted for _, wanted in labels], widths, 22, picture.shape)
    for (number, _), place in zip(labels, places, strict=True):
        draw_text(picture, str(number), place, object_colour(number), 0.6, tag=True)


def write_picture(path: Path, picture: Picture) -> None:
    """Write (h, w, 3) uint8 RGB as PNG. Raises OSError where the file cannot be written."""
    with whole_file(path) as stream:
        stream.write(png_bytes(picture))


def png_bytes(picture: Picture) -> bytes:
    """(h, w, 3) uint8 RGB as PNG."""
    return cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()


def _overlap(a: tuple[float, float, int], b: tuple[float, float, int], height: int) -> bool:
    return abs(a[1] - b[1]) < height and a[0] < b[0] + b[2] + 8 and b[0] < a[0] + a[2] + 8


def _fixed(lines: NDArray[np.float64]) -> list[NDArray[np.int32]]:
    # Segments are clipped by the caller; the bound only keeps OpenCV's fixed-point numbers in range.
    return list(np.clip(np.rint(lines * (1 << _SUBPIXEL_BITS)), -(2**24), 2**24).astype(np.int32))
