"""One RGB-D frame, as every stage's core sees it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics

_DEPTH_MAX = 1e5
"""Depth is never more, metres, even if millimetres are taken for metres; floats beyond it mark that there is none."""


@dataclass(frozen=True, slots=True)
class RgbdFrame:
    """Colour registered with depth (same pixel, same ray), validated once, here.

    stamp_ns: capture time, integer nanoseconds.
    colour: (h, w, 3) uint8, RGB.
    depth: (h, w) uint16 in units of `depth_scale` metres, or float32 metres (`depth_scale` 1); 0 = invalid.
    T_world_camera: (4, 4) float64 pose known to the source (data-set truth, a robot's own odometry), or None.
    """

    stamp_ns: int
    colour: NDArray[np.uint8]
    depth: NDArray[np.uint16] | NDArray[np.float32]
    depth_scale: float
    intrinsics: Intrinsics
    T_world_camera: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if self.depth.dtype not in (np.dtype(np.uint16), np.dtype(np.float32)):
            raise ValueError(f"depth is {self.depth.dtype}; give uint16 with depth_scale, or float32 in metres")
        if self.colour.dtype != np.uint8 or self.colour.shape != (*self.intrinsics.shape, 3):
            raise ValueError(
                f"colour is {self.colour.dtype} {self.colour.shape}; expected uint8 {(*self.intrinsics.shape, 3)}"
            )
        if self.depth.shape != self.intrinsics.shape:
            raise ValueError(f"depth is {self.depth.shape}, but the intrinsics are for {self.intrinsics.shape}")
        if not (np.isfinite(self.depth_scale) and self.depth_scale > 0):
            raise ValueError(f"depth_scale must be positive (metres per unit), got {self.depth_scale}")

    def depth_metres(self) -> NDArray[np.float32]:
        """Depth as (h, w) float32 metres; what is not positive, finite and at most 100 km becomes 0 = invalid."""
        metres = self.depth.astype(np.float32)
        largest = _DEPTH_MAX / self.depth_scale
        if self.depth.dtype == np.float32 or largest < np.iinfo(np.uint16).max:
            metres[~((metres > 0) & (metres <= largest))] = 0
        if self.depth_scale != 1:
            metres *= np.float32(self.depth_scale)
        return metres
