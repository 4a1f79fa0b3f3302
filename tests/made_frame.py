"""Frames of depth that a test has made."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame


def frame_of(
    stamp_ns: int,
    depth: NDArray[np.floating],
    camera: Intrinsics,
    given: NDArray[np.float64] | None = None,
    colour: NDArray[np.uint8] | None = None,
) -> RgbdFrame:
    """A frame of depth (h, w) in metres with a given pose; in the dark, where no colour is given."""
    dark = np.zeros((*camera.shape, 3), np.uint8)
    return RgbdFrame(stamp_ns, dark if colour is None else colour, depth.astype(np.float32), 1.0, camera, given)
