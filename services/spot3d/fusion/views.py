"""From where the scene was looked at, and what could be seen from there."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, invert
from spot3d.fusion.identity import FoundObject
from spot3d.fusion.settings import FusionSettings
from spot3d.sensor import axial_noise

_REMEMBERED = 1000
"""Most views kept; beyond, every second one goes, and only every second one more is taken in."""
_SEEN_SHARE = 0.1
"""An object is there in at least this share of the frames that look its way, whatever hides it now and then."""
_BAND = 6.0
"""Noise spreads a surface over three standard deviations each way: what is no wider may be noise alone."""


class Views:
    """Poses of evenly spread frames."""

    def __init__(self) -> None:
        # Arrays that are replaced and never written to, so that copies may share them.
        self._T_camera_world: NDArray[np.float64] = np.zeros((0, 4, 4))
        self._pinhole: NDArray[np.float64] = np.zeros((0, 6))
        self._offered, self._step = 0, 1

    def add(self, T_world_camera: NDArray[np.float64], camera: Intrinsics) -> None:
        """Remember one frame's pose."""
        if self._offered % self._step == 0:
            pinhole = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
            self._T_camera_world = np.concatenate((self._T_camera_world, invert(T_world_camera)[None]))
            self._pinhole = np.concatenate((self._pinhole, [pinhole]))
        self._offered += 1
        if len(self._pinhole) > _REMEMBERED:
            self._T_camera_world, self._pinhole = self._T_camera_world[::2], self._pinhole[::2]
            self._step *= 2

    def copy(self) -> "Views":
        """Views of its own with the same poses."""
        other = Views()
        other._T_camera_world, other._pinhole = self._T_camera_world, self._pinhole
        other._offered, other._step = self._offered, self._step
        return other

    def looking_at(
        self, points: NDArray[np.float64], range_max: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Share of the views that have each of (n, 3) world points in the picture and in range: (n,).

        And its median depth there, (n,) metres; where none has, that is `range_max`.
        """
        if len(self._pinhole) == 0:
            return np.zeros(len(points)), np.full(len(points), range_max)
        T = self._T_camera_world
        fx, fy, cx, cy, width, height = self._pinhole.T
        x, y, z = (points @ T[:, axis, :3].T + T[:, axis, 3] for axis in range(3))  # (n, views) each
        ahead = np.where((z > 0) & (z <= range_max), z, np.inf)
        u, v = fx * x / ahead + cx, fy * y / ahead + cy
        seen = np.isfinite(ahead) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        count, depth = seen.sum(axis=1), np.sort(np.where(seen, z, np.inf), axis=1)
        middle = np.stack((np.maximum(count - 1, 0) // 2, np.minimum(count // 2, len(T) - 1)), axis=1)
        median = np.take_along_axis(depth, middle, axis=1).mean(axis=1)
        return count / len(T), np.where(count > 0, median, range_max)


def borne_out(found: list[FoundObject], views: Views, frame_count: int, settings: FusionSettings) -> list[FoundObject]:
    """The objects seen often, of how often they could have been, and wider than the noise at their range."""
    share, depth = views.looking_at(np.array([item.box.centre for item in found]).reshape(-1, 3), settings.range_max)
    often, wide = _SEEN_SHARE * share * frame_count, _BAND * axial_noise(depth)
    return [
        item
        for item, least, width in zip(found, often, wide, strict=True)
        if item.views >= least and sorted(item.box.size.tolist())[1] >= width
    ]
