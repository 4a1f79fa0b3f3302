"""Which parts of a frame (candidate segments) are no objects, and why."""

import numpy as np
from numpy.typing import NDArray

from spot3d.frame_segments import TOO_COLD, TOO_LONG, TOO_LOW, TOO_SMALL
from spot3d.geometry.downsampling import LatticeFrame
from spot3d.geometry.quantiles import quantiles
from spot3d.geometry.upright import taken
from spot3d.segments.settings import SegmentsSettings

_CUBE_SEEN = 2**0.5
"""A camera that looks down on a cube at 45 degrees sees this many times the area of one face. With 1, glare and
fragments cost 0.03 of HOTS' success rate and 0.01 of clutter's, and no more objects are found."""


def fault_of(
    pixels: NDArray[np.int64],
    frame: LatticeFrame,
    points: NDArray[np.float32],
    height: NDArray[np.float32],
    settings: SegmentsSettings,
) -> str:
    """Why a part is no object: too small, too low above the support, too long or too cold; empty if it is one.

    pixels: (n,) flat indices of its pixels; points: (h, w, 3) metres, camera frame; height: (h, w) metres above the
    support.
    """
    flat = taken(points.reshape(-1, 3), pixels)
    if not covers_least(flat, frame, settings):
        return TOO_SMALL
    if quantiles(height.ravel()[pixels], 0.9)[0] < settings.height_min:
        return TOO_LOW
    coordinates = np.ascontiguousarray(flat.T)  # apart they are faster
    centred = coordinates - coordinates.mean(axis=1, keepdims=True)
    longest = np.linalg.eigh(centred @ centred.T)[1][:, 2]
    if float(np.ptp(longest @ centred)) > settings.size_max:
        return TOO_LONG
    return TOO_COLD if float(frame.heat.ravel()[pixels].mean()) / 255 < settings.heat_min else ""


def covers_least(flat: NDArray[np.float32], frame: LatticeFrame, settings: SegmentsSettings) -> bool:
    """Whether these (n, 3) points of a frame cover at least the visible area of the smallest object."""
    area = float((flat[:, 2] ** 2).sum()) / (frame.camera.fx * frame.camera.fy)
    return area >= _CUBE_SEEN * settings.size_min**2
