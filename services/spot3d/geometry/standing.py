"""Which parts of a view stand on a plane."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.geometry.quantiles import quantiles
from spot3d.geometry.upright import are_below, taken

_LOWEST = 0.02
"""This share of a part's points may lie below its bottom: noise, and pixels at its edge."""
_AROUND = np.ones((7, 7), np.uint8)
"""Pixels up to three away are around a part: edges of depth wander by two, or have none."""


def stands_on(
    pixels: NDArray[np.int64],
    height: NDArray[np.floating],
    points: NDArray[np.float32],
    up: NDArray[np.float64],
    within: float,
) -> bool:
    """Whether a part's bottom is on a plane, or is hidden by the part while most pixels around it are on the plane.

    pixels: (n,) flat indices of those with depth; height: (h, w) metres above the plane; points: (h, w, 3) metres,
    camera frame, z = 0 invalid; up: (3,) unit, camera frame; within: heights that count as zero, metres.
    """
    if not len(pixels):
        return False
    bottom = float(quantiles(height.ravel()[pixels], _LOWEST)[0])
    if abs(bottom) < within:
        return True
    if bottom < 0 or not is_below_camera(taken(points.reshape(-1, 3), pixels), up):
        return False
    part = np.zeros(height.shape, np.uint8)
    part.ravel()[pixels] = 1
    around = (cv2.dilate(part, _AROUND) > part) & (points[..., 2] > 0)
    return bool(around.any() and np.median(height[around]) < within)


def is_below_camera(places: NDArray[np.float32], up: NDArray[np.float64]) -> bool:
    """Whether a camera looks down so steeply on a part that it hides its support: (n, 3) metres, camera frame."""
    middle = np.array(places.T, np.float64, order="C").mean(axis=1)  # coordinates are faster apart
    return bool(are_below(-middle[None], up)[0])
