"""Which parts of a frame are no objects, and why."""

import numpy as np
from numpy.typing import NDArray

from spot3d.frame_segments import TOO_COLD, TOO_LONG, TOO_LOW, TOO_SMALL
from spot3d.geometry.downsampling import LatticeFrame
from spot3d.segments.settings import SegmentsSettings

_FACES = 2**0.5
"""A cube shows this many of its faces' area to a camera that looks down on it at 45 degrees. With 1, glare and
fragments cost 0.03 of HOTS' success rate, and 0.01 of clutter's; nothing more is found."""


def fault_of(
    pixels: NDArray[np.int64],
    frame: LatticeFrame,
    points: NDArray[np.float32],
    height: NDArray[np.float32],
    settings: SegmentsSettings,
) -> str:
    """Why a part is no object, if so: it covers less than the least one, is too low above the support, long or cold.

    pixels: (n,) flat numbers of the part's; points: (h, w, 3) metres, camera frame; height: (h, w) metres above the
    support.
    """
    flat = points.reshape(-1, 3)[pixels]
    if not covers_least(flat, frame, settings):
        return TOO_SMALL
    if float(np.quantile(height.ravel()[pixels], 0.9)) < settings.height_min:
        return TOO_LOW
    centred = flat - flat.mean(axis=0)
    longest = np.linalg.eigh(centred.T @ centred)[1][:, 2]
    if float(np.ptp(centred @ longest)) > settings.size_max:
        return TOO_LONG
    return TOO_COLD if float(frame.heat.ravel()[pixels].mean()) / 255 < settings.heat_min else ""


def covers_least(flat: NDArray[np.float32], frame: LatticeFrame, settings: SegmentsSettings) -> bool:
    """Whether these (n, 3) points of a frame cover as much as the least object."""
    area = float((flat[:, 2] ** 2).sum()) / (frame.camera.fx * frame.camera.fy)
    return area >= _FACES * settings.size_min**2
