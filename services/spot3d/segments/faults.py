"""Which parts of a frame are no objects, and why."""

import numpy as np
from numpy.typing import NDArray

from spot3d.frame_segments import TOO_LONG, TOO_LOW, TOO_SMALL
from spot3d.geometry.downsampling import LatticeFrame
from spot3d.segments.settings import SegmentsSettings

_HOT = 0.5
"""The hottest part of a frame is mostly hotter than this; a frame's heat is a share of its maximum, which wanders."""
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
    """Why a part is no object, if so: it covers less than the least one, is too low above the support, or too long.

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
    return TOO_LONG if float(np.ptp(centred @ longest)) > settings.size_max else ""


def covers_least(flat: NDArray[np.float32], frame: LatticeFrame, settings: SegmentsSettings) -> bool:
    """Whether these (n, 3) points of a frame cover as much as the least object."""
    area = float((flat[:, 2] ** 2).sum()) / (frame.camera.fx * frame.camera.fy)
    return area >= _FACES * settings.size_min**2


def warm_parts(parts: list[NDArray[np.int64]], heat: NDArray[np.uint8], heat_min: float) -> list[NDArray[np.int64]]:
    """The parts whose mean heat reaches `heat_min`, or less where even the hottest part is colder than `_HOT`.

    parts: flat pixel numbers of each; heat: (h, w) uint8, 255ths.
    """
    means = np.array([heat.ravel()[part].mean() / 255 for part in parts])
    least = heat_min * min(1.0, means.max(initial=0.0) / _HOT)
    return [part for part, mean in zip(parts, means.tolist(), strict=True) if mean >= least]
