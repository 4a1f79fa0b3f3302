"""Parts of walls: upright surfaces behind which nothing is seen.

Furniture and appliances cut a wall into pieces that are no longer than an object: between a counter and the cupboards
above it, or between the boards of a bookcase. Beside an object the camera sees what lies behind it; beside a piece of a
wall everything is nearer.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.downsampling import LatticeFrame
from spot3d.geometry.upright import taken
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import FACING

_LEVEL = 0.5
"""The normal of a wall is level to 30 degrees: less of it than this points along up."""
_FLAT = 0.8
"""At least this share of a wall's pixels face as the whole does, to 37 degrees; fewer do on an edge or a curve."""
_RING = 3
"""Pixels around a part that show what is beside it, 2 cm at 2 m: two over which edges mix depth, and one more."""
_SEEN = 0.5
"""Of this ring at least this share must have depth; the border of the image and holes hide the rest. Without this a
chair's back that the image cuts off, on redkitchen with KISS-ICP, counts as a wall."""
_BEHIND = 0.05
"""A wall has no more than this share of what is seen around it behind its plane. On redkitchen this is at most 0.01 for
pieces of walls, 0.1 to 0.5 for sides of cupboards, 0.5 to 1 for backs of chairs, leaflets and books. Success and boxes
of no object on five bookcases: 0.86 and 1.4 a scene with this step, 0.85 and 1.6 without; with 10 % of depth missing
0.77 and 2.4, 0.73 and 3.0. Detection is the same. With 0.02 and 0.1 three of them come out as with 0.05."""


def is_wall(
    pixels: NDArray[np.int64],
    frame: LatticeFrame,
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    up: NDArray[np.float64],
    settings: SegmentsSettings,
) -> bool:
    """Whether a part of a frame is a piece of a wall.

    pixels: (n,) flat indices of its pixels; points, normals: (h, w, 3) float32, camera frame; up: (3,) unit, camera
    frame. A point is behind the part's plane if it is so by more than the least object (`size_min`) and noise.
    """
    coordinates = np.array(taken(points.reshape(-1, 3), pixels).T, np.float64, order="C")  # apart they are faster
    middle = coordinates.mean(axis=1)
    centred = coordinates - middle[:, None]
    axes = np.linalg.eigh(centred @ centred.T)[1]
    normal = axes[:, 0] if axes[:, 0] @ middle < 0 else -axes[:, 0]
    if abs(float(normal @ up)) > _LEVEL:
        return False
    if float(np.mean(taken(normals.reshape(-1, 3), pixels) @ normal.astype(np.float32) > FACING)) < _FLAT:
        return False
    own = np.zeros(frame.depth.shape, np.uint8)
    own.ravel()[pixels] = 1
    around = cv2.dilate(np.pad(own, _RING), np.ones((2 * _RING + 1, 2 * _RING + 1), np.uint8))
    ring = (around[_RING:-_RING, _RING:-_RING] > own) & (frame.depth > 0)
    seen = taken(points.reshape(-1, 3), np.flatnonzero(ring))
    if len(seen) < _SEEN * (np.count_nonzero(around) - len(pixels)):
        return False
    step = np.maximum(np.float32(settings.size_min), settings.noise_gate * frame.camera.noise.sigma(seen[:, 2]))
    behind = (seen - middle) @ normal < -step
    return bool(behind.mean() <= _BEHIND)
