"""Degrades poses like odometry and motion capture do: smooth errors, a delay, or a wrong mount."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Pose = NDArray[np.float64] | None
CORRELATION_FRAMES = 10.0
"""Correlation time of errors: about a third of a second at 30 Hz, like drift and the misfit of a marker."""


def shaken(poses: Sequence[Pose], metres: float, degrees: float, seed: int) -> list[Pose]:
    """Poses T_world_camera (4, 4) float64, each rotated and shifted in its camera's frame by a smooth random error.

    The six components of the error are Ornstein-Uhlenbeck processes that start from no error: standard deviation
    `metres` and `degrees` along each axis, correlation time ten frames. A frame without a pose stays without. The same
    seed gives the same errors.
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
    """Gives each frame the pose of `frames` frames before. The first ones keep the first pose."""
    return [poses[max(0, number - frames)] for number in range(len(poses))]


def misplaced(poses: Sequence[Pose], metres: float, degrees: float, seed: int) -> list[Pose]:
    """Poses of a body that is `metres` from the camera and rotated by `degrees` against it, in random directions.

    It stands for a tracker whose mounting is not known exactly. The same seed gives the same error.
    """
    directions = np.random.default_rng(seed).normal(size=(2, 3))
    shift, axis = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    error = np.eye(4)
    error[:3, :3], error[:3, 3] = cv2.Rodrigues(np.radians(degrees) * axis)[0], metres * shift
    return [None if pose is None else pose @ error for pose in poses]
