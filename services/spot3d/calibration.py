"""What is corrected of a camera that does not agree with the poses that are given for it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics


@dataclass(frozen=True, slots=True)
class Calibration:
    """How depth, intrinsics and mounting turned out to be; as it is made, nothing is known but what was told.

    depth_factor: what depth is multiplied by; turn: rotation vector about the camera's axes, radians, by which it is
    turned against what the poses are of; centre: by how much further to the right and down a thing at unit distance
    lies than the intrinsics say: the principal point is off by so many focal lengths.
    """

    depth_factor: float = 1.0
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)

    def camera(self, told: Intrinsics) -> Intrinsics:
        """The intrinsics that are right where these were told."""
        x, y = self.centre
        return replace(told, cx=told.cx - x * told.fx, cy=told.cy - y * told.fy)

    def metres(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """The depth that is right where this, (h, w) metres, was measured."""
        return depth if self.depth_factor == 1 else depth * np.float32(self.depth_factor)


AS_TOLD = Calibration()
"""Nothing is corrected."""


def sheared(centre: tuple[float, float]) -> NDArray[np.float64]:
    """(3, 3): how what a camera sees moves in its frame where its principal point is off (see `Calibration`)."""
    return np.array(((1.0, 0.0, centre[0]), (0.0, 1.0, centre[1]), (0.0, 0.0, 1.0)))


def moved_planes(
    planes: NDArray[np.float64], linear: NDArray[np.float64], about: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(k, 4) planes [n, b], n.x + b = 0, where their points move by `linear` (3, 3) about a point (3,).

    Zeros, which are no plane, stay zeros.
    """
    normals = planes[:, :3] @ np.linalg.inv(linear)
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    away = (planes[:, 3:] + (planes[:, :3] @ about)[:, None]) / length
    normals = normals / length
    return np.hstack((normals, away - (normals @ about)[:, None]))
