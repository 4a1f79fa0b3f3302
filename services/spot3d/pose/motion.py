"""Small rigid-body algebra: twists, extrapolation."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import invert
from spot3d.trajectory import nearest_rotation, rotation_angle, rotation_from_vector


def vector_from_rotation(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vector, radians, of a (3, 3) rotation by less than pi, as between frames."""
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return axis / (2 * float(np.sinc(float(rotation_angle(rotation)) / np.pi)))


def moved(T_world_camera: NDArray[np.float64], twist: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose after a small motion in world axes: twist (6,) = translation, rotation vector about the camera."""
    result = T_world_camera.copy()
    result[:3, :3] = rotation_from_vector(twist[3:]) @ T_world_camera[:3, :3]
    result[:3, 3] += twist[:3]
    return result


def turned(T_world_camera: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose of a camera turned by a rotation vector (3,) about its own axes."""
    result = T_world_camera.copy()
    result[:3, :3] = T_world_camera[:3, :3] @ rotation_from_vector(turn)
    return result


def rigid(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pose (4, 4) without the rounding of its rotation."""
    result = T.copy()
    result[:3, :3] = nearest_rotation(T[:3, :3])
    return result


def twist(T_world_from: NDArray[np.float64], T_world_to: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motion (6,) between two poses in world axes, as `moved` takes it."""
    turn = vector_from_rotation(T_world_to[:3, :3] @ T_world_from[:3, :3].T)
    return np.concatenate((T_world_to[:3, 3] - T_world_from[:3, 3], turn))


def shift_and_turn(T_world_from: NDArray[np.float64], T_world_to: NDArray[np.float64]) -> tuple[float, float]:
    """How far one pose is from another, metres, and by what angle they differ, radians."""
    motion = invert(T_world_from) @ T_world_to
    return float(np.linalg.norm(motion[:3, 3])), float(rotation_angle(motion[:3, :3]))


def extrapolated(
    T_world_before: NDArray[np.float64], T_world_last: NDArray[np.float64], ratio: float
) -> NDArray[np.float64]:
    """Pose at constant velocity: the last one moved on by `ratio` times the motion from the one before to it."""
    step = invert(T_world_before) @ T_world_last
    motion = np.eye(4)
    motion[:3, :3] = rotation_from_vector(ratio * vector_from_rotation(step[:3, :3]))
    motion[:3, 3] = ratio * step[:3, 3]
    return T_world_last @ motion


FARTHEST_M = 1e7
"""No place on Earth is farther along an axis from the origin of a map's grid, such as UTM's. With 1e155 KISS-ICP ends
its process."""


def checked_pose(T: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """The (4, 4) pose as an exact rigid transform, or None where it is none (shape, nan, not a rotation) or off Earth.

    Data sets round their matrices, so a deviation from orthogonality of up to one per cent is corrected.
    """
    if T is None or np.shape(T) != (4, 4):
        return None
    pose = np.array(T, np.float64)
    rotation = pose[:3, :3]
    if not np.isfinite(pose).all() or np.abs(pose[:3, 3]).max() > FARTHEST_M:
        return None
    if not np.allclose(pose[3], (0, 0, 0, 1), atol=1e-6):
        return None
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 0.01 or np.linalg.det(rotation) < 0:
        return None
    pose[:3, :3] = nearest_rotation(rotation)
    pose[3] = (0, 0, 0, 1)
    return pose
