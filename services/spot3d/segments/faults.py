"""Which parts of a frame (candidate segments) are no objects, and why."""

import cv2
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

_TOP = 0.9
"""The highest tenth of a part, and the steepest tenth of its edge, may be noise."""
_BENT = 0.04
"""What is higher than this, metres, is no support that is bent. With 2.5 and 4 cm, and without a limit, it is the same
but for one object of HOTS."""
_BESIDE = 0.01
"""An object rises by `height_min` within this distance, metres; a support that is bent rises far less steeply than by
45 degrees. With 0.5, 1 and 2 cm success on single frames of HOTS with all depth, and so its bends, 1.25 times as large
is 0.86, 0.85, 0.81, and 0.81 without this; on HOTS and OSD themselves it is the same to 0.001."""
_TOLD = 5
"""From fewer pixels of the support beside a part nothing is concluded. With 2, 5, 15 HOTS and OSD are the same, also
bent."""


def fault_of(
    pixels: NDArray[np.int64],
    frame: LatticeFrame,
    points: NDArray[np.float32],
    height: NDArray[np.float32],
    settings: SegmentsSettings,
) -> str:
    """Why a part is no object: too small, too low above the support or without an edge there, too long or too cold;
    empty if it is one.

    pixels: (n,) flat indices of its pixels; points: (h, w, 3) metres, camera frame; height: (h, w) metres above the
    support.
    """
    flat = taken(points.reshape(-1, 3), pixels)
    if not covers_least(flat, frame, settings):
        return TOO_SMALL
    (top,) = quantiles(height.ravel()[pixels], _TOP)
    if top < settings.height_min or (top < _BENT and not _has_edge(pixels, frame, height, settings.height_min)):
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


def _has_edge(pixels: NDArray[np.int64], frame: LatticeFrame, height: NDArray[np.float32], least: float) -> bool:
    """Whether a part rises from the support beside it in a step of `least` metres, or nothing is seen of that."""
    h, w = height.shape
    v, u = np.divmod(pixels, w)
    reach = max(2, round(_BESIDE * frame.camera.fx / float(np.median(frame.depth.ravel()[pixels]))))
    around = (
        slice(max(0, v.min() - reach), min(h, v.max() + reach + 1)),
        slice(max(0, u.min() - reach), min(w, u.max() + reach + 1)),
    )
    part = np.full(height.shape, -np.inf, np.float32)
    part.ravel()[pixels] = height.ravel()[pixels]
    part, beside = part[around], height[around]
    highest = cv2.dilate(part, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    support = np.isinf(part) & (highest > -np.inf) & (frame.depth[around] > 0) & (np.abs(beside) < 2 * least)
    rise = (highest - beside)[support]
    return len(rise) < _TOLD or bool(quantiles(rise, _TOP)[0] >= least)
