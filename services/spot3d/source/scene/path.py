"""Paths of the hand-held camera in the built-in scenes."""

import numpy as np
from numpy.typing import NDArray

from spot3d.source.scene.name import SceneKind

RATE_HZ = 30
# Half the arc around the table, its horizontal radii across and along the table, and the target point; metres.
HALF_ARC = np.radians(56)
RADIUS_ACROSS, RADIUS_ALONG = 1.0, 1.05
TARGET = np.array([-0.06, 0.0, 0.80])
HEIGHT = 1.48
FRAMES_PER_SWEEP = 300
# Around the desk: the distance and pace of a person who walks around it, 13 mm a frame.
ORBIT_RADIUS, ORBIT_SWELL = 1.9, 0.2
FRAMES_PER_ORBIT = 900
# Before the desk, at the head of a person who works there: amplitudes, and periods in seconds, of the motion to and
# from the desk, along it, and up.
HEAD = np.array([0.75, 0.0, 1.28])
HEAD_MOVES, HEAD_TAKES_S = np.array([0.18, 0.75, 0.12]), np.array([5.3, 9.0, 4.1])
# Before the shelves: mean radius, its relative variation, half the arc in radians, and the target point.
SHELF_RADIUS, SHELF_SWELL, SHELF_ARC = 1.25, 0.2, 0.75
SHELF_TARGET = np.array([-0.15, 0.0, 0.9])
# Above the bin: a camera on a robot's wrist, its amplitudes, and the target point.
WRIST = np.array([0.36, 0.0, 1.60])
WRIST_MOVES = np.array([0.12, 0.35, 0.10])
BIN_TARGET = np.array([0.0, 0.0, 0.75])
# In the room: mean radius, its relative variation, half the arc in radians, and the target point.
ROOM_RADIUS, ROOM_SWELL, ROOM_ARC = 1.5, 0.15, 0.9
ROOM_TARGET = np.array([0.1, 0.3, 0.55])


def camera_pose(index: int, seed: int, kind: SceneKind) -> NDArray[np.float64]:
    """T_world_camera (4, 4) float64 of frame `index` >= 0 at 30 Hz, for a sequence of any length.

    The camera's height and distance change slowly, so that no two sweeps are alike. A hand's tremor, whose phases
    depend on the seed, is added.
    """
    phase = np.random.default_rng((seed, 11)).uniform(0, 2 * np.pi, 12)
    seconds = index / RATE_HZ
    eye, target = _PATHS[kind](index, phase)
    wave = np.sin(2 * np.pi * seconds * np.array([0.6, 0.7, 0.8, 0.9, 0.75, 0.65]) + phase[3:9])
    shake = np.sin(2 * np.pi * seconds * np.array([4.3, 5.1, 3.7]) + phase[9:])
    T_world_camera = look_at(eye + 0.004 * wave[:3], target)
    T_world_camera[:3, :3] @= small_rotation(np.radians(0.7) * wave[3:] + np.radians(0.08) * shake)
    return T_world_camera


def _before_table(index: int, phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eye and target (3,) of a camera that sweeps to and fro before the table, in 300 frames one way.

    It moves by about 7 mm and 0.45 degrees a frame.
    """
    # A triangle wave with rounded turns: nearly constant speed.
    sweep = np.arcsin(0.92 * np.sin(np.pi * index / FRAMES_PER_SWEEP - np.pi / 2)) / np.arcsin(0.92)
    angle = HALF_ARC * sweep
    swell = 1 + 0.07 * np.sin(2 * np.pi * index / 430 + phase[0])
    height = HEIGHT + 0.09 * np.sin(2 * np.pi * index / 370 + phase[1])
    eye = np.array([RADIUS_ACROSS * swell * np.cos(angle), RADIUS_ALONG * swell * np.sin(angle), height])
    return eye, TARGET + np.array([0.0, 0.10 * np.sin(2 * np.pi * index / 260 + phase[2]), 0.0])


def _around_desk(index: int, phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eye and target (3,) of a camera that circles the desk in 900 frames, 1.5 to 2.3 m from its middle."""
    angle = phase[0] + 2 * np.pi * index / FRAMES_PER_ORBIT
    radius = ORBIT_RADIUS * (1 + ORBIT_SWELL * np.sin(2 * np.pi * index / 430 + phase[1]))
    height = HEIGHT + 0.09 * np.sin(2 * np.pi * index / 370 + phase[2])
    eye = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
    return eye, TARGET + 0.10 * np.array([0.0, np.sin(2 * np.pi * index / 260 + phase[2]), 0.0])


def _near_desk(index: int, phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eye and target (3,) of a camera that sweeps before the desk, 0.6 to 1.5 m from its target.

    It moves by about 13 mm and 0.9 degrees a frame. Most of the time the image border cuts things off.
    """
    seconds = index / RATE_HZ
    eye = HEAD + HEAD_MOVES * np.sin(2 * np.pi * seconds / HEAD_TAKES_S + phase[[1, 0, 2]])
    to_desk = 0.2 * np.sin(2 * np.pi * seconds / 3.7 + phase[2])
    along = 0.35 * np.sin(2 * np.pi * seconds / 4.7 + phase[1] + 1)
    return eye, np.array([to_desk - 0.02, 0.6 * eye[1] + along, 0.78])


def _before_shelf(index: int, phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eye and target (3,) of a camera that sweeps to and fro before the shelves, on a radius of 1 to 1.5 m.

    It is as high as the head of a seated person: it looks down on two boards, and along the upper one or up to it.
    """
    angle = SHELF_ARC * np.sin(2 * np.pi * index / 450 - np.pi / 2)
    radius = SHELF_RADIUS * (1 + SHELF_SWELL * np.sin(2 * np.pi * index / 330 + phase[1]))
    height = 1.25 + 0.1 * np.sin(2 * np.pi * index / 270 + phase[2])
    eye = np.array([SHELF_TARGET[0] + radius * np.cos(angle), radius * np.sin(angle), height])
    return eye, SHELF_TARGET + np.array([0.0, 0.15 * np.sin(2 * np.pi * index / 240 + phase[3]), 0.0])


def _above_bin(index: int, phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eye and target (3,) of a camera above the bin, 0.8 to 1.1 m from its target, looking down by 55 to 75 degrees."""
    angles = 2 * np.pi * index / np.array([230.0, 310.0, 270.0]) + (phase[1], -np.pi / 2, phase[2])
    eye = WRIST + WRIST_MOVES * np.sin(angles)
    along = 0.08 * np.sin(2 * np.pi * index / 190 + phase[3])
    return eye, BIN_TARGET + np.array([0.0, 0.7 * eye[1] + along, 0.0])


def _in_room(index: int, phase: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eye and target (3,) of a camera that sweeps to and fro before the table, on a radius of 1.3 to 1.7 m."""
    angle = ROOM_ARC * np.sin(2 * np.pi * index / 600 - np.pi / 2)
    radius = ROOM_RADIUS * (1 + ROOM_SWELL * np.sin(2 * np.pi * index / 430 + phase[1]))
    height = HEIGHT + 0.1 * np.sin(2 * np.pi * index / 370 + phase[2])
    eye = ROOM_TARGET + np.array([radius * np.cos(angle), radius * np.sin(angle), height - ROOM_TARGET[2]])
    return eye, ROOM_TARGET + np.array([0.0, 0.15 * np.sin(2 * np.pi * index / 310 + phase[3]), 0.0])


_PATHS = {
    "table": _before_table,
    "cluttered": _before_table,
    "desk": _around_desk,
    "near": _near_desk,
    "shelf": _before_shelf,
    "bin": _above_bin,
    "room": _in_room,
    "changing": _before_table,
}


def look_at(eye: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """T_world_camera (4, 4) of a camera at `eye` (3,) that looks at `target` (3,) with its x axis level."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack((right, np.cross(forward, right), forward), axis=1)
    T_world_camera[:3, 3] = eye
    return T_world_camera


def small_rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation (3, 3) about the axis of `vector` (3,) by its length in radians (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
