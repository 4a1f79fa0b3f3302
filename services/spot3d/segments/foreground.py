"""Which pixels of a single view stand out: above what things stand on, and on no wall, floor or ceiling."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.planes import on_plane, plane_tolerance
from spot3d.segments.settings import SegmentsSettings

_FACING = np.float32(0.8)
"""Cosine (37 degrees) of a pixel's normal to that of the plane it lies on; noise tilts normals by less."""
_PIXELS = 200
"""A piece of a plane of fewer pixels is not looked at: as long as eps_max it would be a line."""
_KERNEL = np.ones((2, 2), np.uint8)


def standing_out(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    height: NDArray[np.float32],
    others: NDArray[np.float64],
    settings: SegmentsSettings,
) -> NDArray[np.bool_]:
    """(h, w) bool: valid pixels above the support by more than noise, on no plane that is longer than an object.

    points, normals: (h, w, 3) float32, camera frame; height: (h, w) float32 metres above the support; others: (k, 4)
    the view's other dominant planes.
    """
    depth = points[..., 2]
    out = (depth > 0) & (depth <= settings.range_max) & (height > plane_tolerance(depth, settings))
    for plane in others:
        facing = normals @ plane[:3].astype(np.float32) > _FACING
        out &= ~_long_pieces(on_plane(plane, points, settings) & facing, points, settings.size_max)
    return _opened(out)


def _long_pieces(on: NDArray[np.bool_], points: NDArray[np.float32], size_max: float) -> NDArray[np.bool_]:
    """The connected pieces of a plane, (h, w) bool, that are longer than `size_max` metres."""
    count, piece, boxes, _ = cv2.connectedComponentsWithStats(on.astype(np.uint8), connectivity=4)
    long = np.zeros(count, np.bool_)
    for number in range(1, count):
        x, y, w, h, pixels = boxes[number]
        if pixels < _PIXELS:
            continue
        places = points[y : y + h, x : x + w][piece[y : y + h, x : x + w] == number]
        centred = places - places.mean(axis=0)
        axes = np.linalg.eigh(centred.T @ centred)[1]
        long[number] = np.ptp(centred @ axes[:, 1:], axis=0).max() > size_max
    return np.asarray(long[piece])


def _opened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without what is narrower than two pixels: single pixels of noise and of glare."""
    eroded = cv2.erode(mask.astype(np.uint8), _KERNEL, anchor=(0, 0))
    return np.asarray(cv2.dilate(eroded, _KERNEL, anchor=(1, 1)) > 0) & mask
