"""Poses that are wrong in the ways of odometry and motion capture: smoothly off, late, or not of the camera."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Pose = NDArray[np.float64] | None
CORRELATION_FRAMES = 10.0
"""Errors stay alike for about a third of a second at 30 Hz, as drift and a marker's misfit do."""


def shaken(poses: Sequence[Pose], metres: float, degrees: float, seed: int) -> list[Pose]:
    """Poses T_world_camera (4, 4) float64, each turned and shifted in its camera's frame by a smooth random error.

    The six components of the error are Ornstein-Uhlenbeck processes that start from no error: standard deviation
    `metres` and `degrees` along each axis, correlation time ten frames. A frame without a pose has none after. Always
    the same for the same seed.
    """
    rng, state = np.random.default_rng(seed), np.zeros(6)
    keep = np.exp(-1 / CORRELATION_FRAMES)
    sigma = np.array([metres] * 3 + [np.radians(degrees)] * 3)
    moved = list[Pose]()
    for pose in poses:
        state = keep * state + np.sqrt(1 - keep**2) * rng.normal(size=6) * sigma
        error = np.eye(4)
        error[:3, :3], error[:3, 3] = cv2.Rodrigues(state[3:])[0], state[:3]
        moved.append(None if pose is None else pose @ error)
    return moved


def late(poses: Sequence[Pose], frames: int) -> list[Pose]:
    """Each frame's pose is that of so many frames before; the first ones keep the first pose."""
    return [poses[max(0, number - frames)] for number in range(len(poses))]


def misplaced(poses: Sequence[Pose], metres: float, degrees: float, seed: int) -> list[Pose]:
    """Poses of what lies `metres` away from the camera and is turned by `degrees` against it, each in some direction:
    a tracker is mounted otherwise than is known. Always the same for the same seed."""
    directions = np.random.default_rng(seed).normal(size=(2, 3))
    shift, axis = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    error = np.eye(4)
    error[:3, :3], error[:3, 3] = cv2.Rodrigues(np.radians(degrees) * axis)[0], metres * shift
    return [None if pose is None else pose @ error for pose in poses]
