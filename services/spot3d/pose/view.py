"""Evidence in one frame of its camera's pose."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.pose.features import FeatureDetector, Features
from spot3d.pose.surface import Surface, information


@dataclass(frozen=True, kw_only=True)
class View:
    """A frame's images and surface, and whether it came at video rate after the frame before.

    colour: (h, w, 3) uint8; depth_m: (h, w) float32 metres, 0 = invalid; weakness_max: see the settings.
    """

    stamp_ns: int
    at_video_rate: bool
    colour: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: Intrinsics
    surface: Surface
    detector: FeatureDetector
    weakness_max: float

    @cached_property
    def features(self) -> Features:
        """Image features, detected once."""
        return self.detector.detect(self.colour, self.depth_m, self.camera)

    @cached_property
    def information(self) -> NDArray[np.float64]:
        """Information (6, 6) of the surface on the pose, in the camera's axes; noise of the normals adds to it."""
        return information(self.surface)

    def is_weak(self, information: NDArray[np.float64]) -> bool:
        """Whether information (6, 6) leaves the pose unconstrained in some direction, relative to the points' noise."""
        least, noise = float(np.linalg.eigvalsh(information)[0]), float(np.median(self.surface.sigma))
        return least <= 0 or least**-0.5 > self.weakness_max * noise
