"""A made-up room of cuboids, seen by a depth camera and sampled as points: what the fusion tests look at."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics
from spot3d.depth_noise import KINECT_V1
from spot3d.fusion.map.selection import FrequentPoints
from spot3d.fusion.settings import PAPER, FusionSettings

CAMERA = Intrinsics(150.0, 150.0, 79.5, 59.5, 160, 120)
COARSE = FusionSettings(
    range_max=4.0,
    lattice_width=160,
    voxel=0.008,
    heat_min=0.25,
)
"""Settings for that camera, whose pixels are 7 mm wide at the table."""
COARSE_PAPER = PAPER.model_copy(update={"voxel": 0.008, "density_points": 8})
"""DBSCAN's count follows the density."""


@dataclass(frozen=True)
class Cuboid:
    """Upright cuboid, metres, world z up; heat: share of full confidence that proposals give it."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float = 0.0
    colour: tuple[int, int, int] = (120, 120, 120)
    heat: float = 0.0

    def box(self) -> Box3D:
        return Box3D(np.array(self.centre), np.array(self.size), rotation_z(self.yaw))


def rotation_z(yaw: float) -> NDArray[np.float64]:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def standing(
    x: float, y: float, size: tuple[float, float, float], yaw: float = 0.0, colour: tuple[int, int, int] = (200, 40, 40)
) -> Cuboid:
    """An object on the table (z = 0)."""
    return Cuboid((x, y, size[2] / 2), size, yaw, colour, heat=1.0)


TABLE = Cuboid((0, 0, -0.02), (1.4, 1.2, 0.04), colour=(180, 150, 110))
FLOOR = Cuboid((0, 0, -0.77), (8, 8, 0.04), colour=(90, 90, 90))
WALL = Cuboid((0, 1.52, 0.5), (8, 0.04, 3), colour=(220, 220, 215))
ROOM = (TABLE, FLOOR, WALL)
"""What a camera sees around the objects."""

BACKDROP = Cuboid((0, 0.72, 0.38), (1.6, 0.04, 0.8), colour=(220, 220, 215))
STAGE = (TABLE, BACKDROP)
"""The same idea, small enough to sample."""

THREE = (
    standing(-0.3, 0.0, (0.12, 0.10, 0.14), 0.4, (200, 40, 40)),
    standing(0.0, 0.1, (0.10, 0.14, 0.18), -0.3, (40, 160, 60)),
    standing(0.3, -0.05, (0.16, 0.10, 0.10), 1.0, (50, 60, 200)),
)


def look_at(eye: ArrayLike, target: ArrayLike = (0, 0, 0.05)) -> NDArray[np.float64]:
    """T_world_camera of a camera at `eye` that looks at `target`, upright."""
    forward = np.subtract(target, eye, dtype=np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.column_stack((right, np.cross(forward, right), forward))
    T[:3, 3] = eye
    return T


def orbit(count: int, turn: float = 1.6, radius: float = 0.95, height: float = 0.7) -> list[NDArray[np.float64]]:
    """Camera poses on an arc in front of the table, `turn` radians wide in all."""
    angles = -np.pi / 2 + np.linspace(-turn / 2, turn / 2, count)
    return [look_at((radius * np.cos(a), radius * np.sin(a), height)) for a in angles]


@dataclass(frozen=True)
class View:
    """What the camera sees: colour (h, w, 3) uint8, depth (h, w) float32 metres, heat (h, w) uint8."""

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    heat: NDArray[np.uint8]


def view(
    T_world_camera: NDArray[np.float64],
    cuboids: tuple[Cuboid, ...],
    noise: np.random.Generator | None = None,
    camera: Intrinsics = CAMERA,
) -> View:
    """Ray-cast the cuboids; heat spills over the objects' rims, as proposals do. noise: the sensor's, or none."""
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(camera.shape)), -1)
    depth = np.full(camera.shape, np.inf)
    hit = np.full(camera.shape, -1)
    for number, cuboid in enumerate(cuboids):
        R = rotation_z(cuboid.yaw).T
        origin = R @ (T_world_camera[:3, 3] - cuboid.centre)
        direction = rays @ (R @ T_world_camera[:3, :3]).T
        direction = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
        half = np.array(cuboid.size) / 2
        ends = np.stack(((-half - origin) / direction, (half - origin) / direction))
        enter, leave = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
        nearer = (enter < leave) & (enter > 0) & (enter < depth)
        depth[nearer], hit[nearer] = enter[nearer], number
    depth[hit < 0] = 0
    if noise is not None:
        depth = np.where(hit >= 0, depth + KINECT_V1.sigma(depth) * noise.normal(size=depth.shape), 0)
    colours = np.array([cuboid.colour for cuboid in cuboids] + [(0, 0, 0)], np.uint8)
    warmth = np.array([255 * cuboid.heat for cuboid in cuboids] + [0.0], np.float32)[hit]
    spilt = np.maximum(warmth, 0.6 * cv2.dilate(warmth, np.ones((7, 7), np.uint8)))
    return View(colours[hit], depth.astype(np.float32), spilt.astype(np.uint8))


def sampled(
    cuboids: tuple[Cuboid, ...],
    step: float = 0.004,
    heat: float = 0.5,
    cold: float = 0.02,
) -> FrequentPoints:
    """Points every `step` metres on the visible faces of cuboids (no bottoms, nothing inside another).

    Structure (heat 0) has `cold` heat, objects have `heat`.
    """
    xyz, warm, colour = [], [], []
    for cuboid in cuboids:
        points = _faces(cuboid, step if cuboid.heat > 0 else 2 * step)
        for other in cuboids:
            if other is not cuboid:
                box = other.box()
                inside = np.abs((points - box.centre) @ box.rotation) <= box.size / 2 + 1e-6
                keep = ~inside.all(axis=1)
                points = points[keep]
        xyz.append(points)
        warm.append(np.full(len(points), heat * cuboid.heat + cold * (cuboid.heat == 0)))
        colour.append(np.tile(cuboid.colour, (len(points), 1)))
    stacked = [np.concatenate(part).astype(np.float32) for part in (xyz, colour, warm)]
    return FrequentPoints(*stacked, frequency=np.full(len(stacked[0]), 20, np.float32))


def _faces(cuboid: Cuboid, step: float) -> NDArray[np.float64]:
    points = []
    half = np.array(cuboid.size) / 2
    for axis in range(3):
        for sign in (-1.0, 1.0):
            if axis == 2 and sign < 0:
                continue
            a, b = (i for i in range(3) if i != axis)
            p, q = (np.arange(-half[i] + step / 2, half[i], step) for i in (a, b))
            grid = np.zeros((len(p) * len(q), 3))
            grid[:, a], grid[:, b] = (g.ravel() for g in np.meshgrid(p, q, indexing="ij"))
            grid[:, axis] = sign * half[axis]
            points.append(grid)
    return np.concatenate(points) @ rotation_z(cuboid.yaw).T + cuboid.centre
