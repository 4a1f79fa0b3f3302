"""The supporting plane: estimated in keyframes, and removed from the heat of every frame (paper, Sec. V-A)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import back_project, invert
from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.fusion.paper.ransac import planes_by_ransac
from spot3d.fusion.paper.removal import project_inliers
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.downsampling import LatticeFrame
from spot3d.geometry.planes import dominant_planes, on_plane, transform_plane

_REMEMBERED = 10_000
"""Most removed planes kept; beyond, every second one goes."""


class SupportingPlane:
    """The supporting plane of the latest keyframe, and of each one before.

    plane: (4,) world, None until there is one; candidates: (k, 4) world, the latest keyframe's dominant planes;
    removed: the planes that were chosen, one a keyframe.
    """

    def __init__(self, settings: FusionSettings) -> None:
        self._settings = settings
        self.plane: NDArray[np.float64] | None = None
        self.candidates = np.zeros((0, 4))
        self.removed: list[NDArray[np.float64]] = []
        self._inliers = np.zeros((0, 3), np.float32)  # the latest keyframe's points on it, world

    def resume(
        self, plane: NDArray[np.float64] | None, candidates: NDArray[np.float64], removed: NDArray[np.float64]
    ) -> None:
        """Resume from another one's state; removed: (k, 4)."""
        self.plane, self.candidates, self.removed = plane, candidates, [*removed]

    def seen_from(self, T_world_camera: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The plane (4,) in the frame of a camera at (4, 4)."""
        return None if self.plane is None else transform_plane(self.plane, invert(T_world_camera))

    def remaining_heat(
        self, frame: LatticeFrame, T_world_camera: NDArray[np.float64], number: int
    ) -> NDArray[np.uint8]:
        """The (h, w) heat of a frame without the plane's; in keyframes the plane is estimated first.

        T_world_camera: (4, 4); number: of the frame, from 0.
        """
        settings = self._settings
        if not settings.plane_removal:
            if self.plane is None:
                self._estimate(frame, back_project(frame.depth, frame.camera), T_world_camera, number)
            return frame.heat
        points = back_project(frame.depth, frame.camera)
        if number % settings.keyframe_interval == 0:
            self._estimate(frame, points, T_world_camera, number)
        plane = self.seen_from(T_world_camera)
        if plane is None:
            return frame.heat
        if settings.plane_pixels == "keyframe" and len(self._inliers):  # a map that is resumed has none
            on = project_inliers(self._inliers, T_world_camera, frame.camera)
        else:
            on = on_plane(plane, points, settings, frame.camera.noise)
        return np.where(on, np.uint8(0), frame.heat)

    def _estimate(
        self, frame: LatticeFrame, points: NDArray[np.float32], T_world_camera: NDArray[np.float64], number: int
    ) -> None:
        """Estimate the plane, starting from the planes known here. points: (h, w, 3) camera frame, z = 0 invalid."""
        settings, noise = self._settings, frame.camera.noise
        known = transform_plane(self.candidates, invert(T_world_camera))
        known = known[known[:, 3] > 0]  # planes that the camera has passed through face away
        rng = np.random.default_rng((settings.seed, number))
        if settings.plane_search == "triples":
            planes = planes_by_ransac(points, settings, rng)
        else:
            planes = dominant_planes(points, settings, rng, known, noise)
        support = supporting_plane(planes, points, frame.heat, settings, noise)
        self.candidates = transform_plane(planes, T_world_camera)
        if support is None:
            return
        self.plane = transform_plane(support, T_world_camera)
        if settings.plane_pixels == "keyframe":
            inliers = points[on_plane(support, points, settings, noise)]
            self._inliers = (inliers @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]).astype(np.float32)
        self.removed.append(self.plane)
        if len(self.removed) > _REMEMBERED:
            self.removed = self.removed[::2]


def supporting_plane(
    planes: NDArray[np.float64],
    points: NDArray[np.float32],
    heat: NDArray[np.uint8],
    settings: FusionSettings,
    noise: DepthNoise = KINECT_V1,
) -> NDArray[np.float64] | None:
    """The plane (4,) whose inliers hold most heat (sum of H_2D; paper, Eq. 10); None if none holds any.

    A support is mostly bare: a plane hotter than `plane_heat_max` on average is left out.
    planes: (n, 4); points: (h, w, 3) float32, camera frame, z = 0 invalid; heat: (h, w) uint8, 255ths.
    """
    best, most = None, 0.0
    for plane in planes:
        inliers = heat[on_plane(plane, points, settings, noise)]
        total = float(inliers.sum(dtype=np.int64)) / 255
        if total > most and total <= settings.plane_heat_max * len(inliers):
            best, most = plane, total
    return best
