"""Whether colour lies on depth: how strongly colour changes at depth edges, for each shift of colour against depth."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.frame import RgbdFrame

_WIDTH = 320
"""Images are scaled to about this width, pixels."""
_REACH, _FAR, _NEAR = 1 / 16, 1 / 50, 1 / 80
"""Shares of the width: shifts that are tried; off depth beyond this; on depth within this, as 7-Scenes' Kinect is."""
_JUMP = 0.06
"""At an edge, inverse depth changes by this share between neighbouring pixels."""
_EDGES_LEAST = 50
"""Frames with fewer edge pixels, away from the borders, are skipped."""
_SMOOTH = 31
"""Window, pixels, of the mean that is subtracted from colour changes: a carpet is no outline."""
_ALL_EDGES_LEAST, _CHANGE_LEAST = 1000, 0.5
"""Least edge pixels of all frames, and least mean colour change there: a few hot pixels in the dark do not count."""
_FRAMES_LEAST, _STANDS_OUT, _BEYOND = 12, 5.0, 1.3
"""Least for certainty: frames, standard deviations of the peak above the mean, and its ratio to the peak on depth.

Redkitchen, fr3/cabinet and the built-in scenes, shifted by 0 or 4 pixels of 640, never have a peak off depth, in 12
frames in a row or over 12 s. With colour of other frames, stripes or noise, no peak stands out. Over 4 s of a moving
camera an offset of 16 pixels is found, or of 24 where colour was 4 off the other way (redkitchen).
"""


class ColourAlignment:
    """Sums, over frames of one size, how strongly colour changes at depth edges, for each shift of colour."""

    def __init__(self) -> None:
        self.frames = 0
        """Frames with enough edges."""
        self._shape: tuple[int, ...] = ()
        self._scale, self._edges = 1, 0.0
        self._changes = np.zeros((1, 1))

    def add(self, colour: NDArray[np.uint8], metres: NDArray[np.float32]) -> None:
        """Take in a frame: colour (h, w, 3), depth (h, w) in metres, 0 invalid. Another size restarts the sums."""
        if metres.shape != self._shape:
            self._begin(metres.shape)
        height, width = (size // self._scale for size in metres.shape)
        reach = len(self._changes) // 2
        if reach == 0 or height < 4 * reach:
            return
        edges = _depth_edges(metres[:: self._scale, :: self._scale][:height, :width])
        inner = edges[reach:-reach, reach:-reach]
        count = float(inner.sum())
        if count < _EDGES_LEAST:
            return
        changes = _colour_changes(cv2.resize(colour, (width, height), interpolation=cv2.INTER_AREA))
        self._changes += cv2.matchTemplate(changes, inner, cv2.TM_CCORR)
        self._edges += count
        self.frames += 1

    def on_depth(self) -> float:
        """Mean colour change at depth edges for the best shift that counts as none; 0: no more than elsewhere."""
        return self._nearby() / max(self._edges, 1.0)

    def offset(self) -> tuple[int, int] | None:
        """The certain offset of colour from depth, pixels of the images to the right and down; None without one."""
        sums, reach = self._changes, len(self._changes) // 2
        spread = float(sums.std())
        row, column = (int(place) - reach for place in np.unravel_index(sums.argmax(), sums.shape))
        if self.frames < _FRAMES_LEAST or max(abs(row), abs(column)) <= _FAR * self._shape[1] / self._scale:
            return None
        peak = float(sums.max())
        if self._edges < _ALL_EDGES_LEAST or peak < _CHANGE_LEAST * self._edges:
            return None
        if peak < float(sums.mean()) + _STANDS_OUT * spread or peak < _BEYOND * self._nearby():
            return None
        return column * self._scale, row * self._scale

    def _nearby(self) -> float:
        """The largest sum for shifts that count as none."""
        reach = len(self._changes) // 2
        steps = round(_NEAR / _REACH * reach)
        near = slice(reach - steps, reach + steps + 1)
        return float(self._changes[near, near].max())

    def _begin(self, shape: tuple[int, ...]) -> None:
        self._shape, self._scale = shape, max(1, round(shape[1] / _WIDTH))
        reach = int(_REACH * shape[1] / self._scale)
        self._changes = np.zeros((2 * reach + 1, 2 * reach + 1))
        self.frames, self._edges = 0, 0.0


class AlignmentWatch:
    """Checks one frame in ten of a camera's first minute or two, until it is certain that colour lies off depth."""

    EVENT = "colour lies off depth"
    _EVERY, _MOST = 10, 300

    def __init__(self) -> None:
        self._alignment, self._seen = ColourAlignment(), 0

    def look(self, frame: RgbdFrame) -> str:
        """A message, given once, that says how far colour is off and what to do; otherwise empty."""
        self._seen += 1
        if self._seen % self._EVERY or self._seen > self._EVERY * self._MOST:
            return ""
        self._alignment.add(frame.colour, frame.depth_metres())
        offset = self._alignment.offset()
        if offset is None:
            return ""
        self._seen = self._EVERY * self._MOST
        sides = zip(offset, (("left", "right"), ("up", "down")), strict=True)
        ways = " and ".join(f"{abs(pixels)} pixels {side[pixels > 0]}" for pixels, side in sides if pixels)
        return f"{self.EVENT}, by about {ways}: register it with depth, in the camera's driver or by calibration.json"


def _depth_edges(metres: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) 1 where valid depth jumps, else 0."""
    valid = metres > 0
    inverse = np.where(valid, 1 / np.maximum(metres, 1e-3), 0).astype(np.float32)
    around = np.ones((3, 3), np.uint8)
    nearest = cv2.dilate(inverse, around)
    farthest = cv2.erode(np.where(valid, inverse, np.float32(np.inf)), around)
    return (valid & (nearest - farthest > _JUMP * nearest)).astype(np.float32)


def _colour_changes(colour: NDArray[np.uint8] | cv2.typing.MatLike) -> NDArray[np.float32]:
    """(h, w) strength of colour changes, compressed where strong, less the local mean."""
    across = cv2.Sobel(colour, cv2.CV_32F, 1, 0)
    along = cv2.Sobel(colour, cv2.CV_32F, 0, 1)
    strength = cv2.magnitude(across, along).max(axis=2)
    changes = np.sqrt(np.minimum(strength, np.float32(300)))
    return np.asarray(changes - cv2.blur(changes, (_SMOOTH, _SMOOTH)), np.float32)
