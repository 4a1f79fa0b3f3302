"""KISS-ICP (Vizzo et al. 2023) with a preset for depth cameras, refined against a local map of planes.

KISS-ICP's point-to-point registration finds the pose from afar; point-to-plane to averaged surfels then
measures it finely. Alone, the first is coarse on depth cameras and the second loses fast motion.
"""

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.mapping import get_voxel_hash_map
from kiss_icp.registration import get_registration
from kiss_icp.threshold import get_threshold_estimator
from kiss_icp.voxelization import voxel_down_sample
from numpy.typing import NDArray

from spot3d.camera import invert
from spot3d.pose.registration import Registration, judged, refined
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import SurfelMap

# KISS-ICP thins its points to a few hundred anyway; a quarter of the lattice is plenty to choose from.
_KISS_STRIDE = 4
# After a loss KISS-ICP runs first against a map of larger voxels, since its search spans neighbouring voxels
# only. Voxel in metres, points in a voxel; sigma is half a voxel, so that correspondences reach 1.5 voxels.
_WIDE_VOXEL, _WIDE_POINTS = 0.3, 10
_WIDE_ITERATIONS, _WIDE_CONVERGENCE = 50, 1e-3


class KissIcp:
    """KISS-ICP and the refinement, with their local maps."""

    def __init__(self, settings: PoseSettings) -> None:
        self._settings = settings
        config = kiss_config(settings)
        self._registration = get_registration(config)
        self._threshold = get_threshold_estimator(config)
        self._map = get_voxel_hash_map(config)
        wide = {"kiss_iterations": _WIDE_ITERATIONS, "kiss_convergence": _WIDE_CONVERGENCE}
        wide_config = kiss_config(
            settings.model_copy(update={**wide, "kiss_voxel": _WIDE_VOXEL, "kiss_points_per_voxel": _WIDE_POINTS})
        )
        self._wide_registration = get_registration(wide_config)
        self._wide_map = get_voxel_hash_map(wide_config)
        self.planes = SurfelMap(settings.surfel_voxel, settings.surfel_limit, beside=False)
        self._deviation: NDArray[np.float64] | None = None

    def register(self, surface: Surface, T_world_guess: NDArray[np.float64], wide: bool) -> Registration:
        """KISS-ICP from the guess, then Gauss-Newton against the plane map."""
        settings = self._settings
        if wide:
            self._deviation = None
            pose = self._align_wide(surface, T_world_guess)
            return judged(
                self.planes, surface, refined(self.planes, surface, pose, settings), settings.recovery_distance
            )
        sigma = self._threshold.get_threshold()
        source = _thinned(surface, 0.5 * settings.kiss_voxel, 1.5 * settings.kiss_voxel)
        pose = self._registration.align_points_to_map(source, self._map, T_world_guess, 3 * sigma, sigma)
        pose = refined(self.planes, surface, pose, settings)
        self._deviation = invert(T_world_guess) @ pose
        return judged(self.planes, surface, pose, settings.refine_distance)

    def insert(self, surface: Surface, T_world_camera: NDArray[np.float64]) -> None:
        """Add an accepted frame to every map; its distance from the prediction adapts the threshold."""
        if self._deviation is not None:
            self._threshold.update_model_deviation(self._deviation)
        self._map.update(_thinned(surface, 0.5 * self._settings.kiss_voxel), T_world_camera)
        self._wide_map.update(_thinned(surface, 0.5 * _WIDE_VOXEL), T_world_camera)
        self.planes.insert(surface, T_world_camera)

    def restored(self) -> None:
        """KISS-ICP's own maps become the places of the surfels."""
        places = self.planes.held()[1][:, :3]
        for voxels in (self._map, self._wide_map):
            voxels.clear()
            voxels.add_points(places)
        self._deviation = None

    def _align_wide(self, surface: Surface, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """KISS-ICP from afar: first against the map of larger voxels."""
        voxel = self._settings.kiss_voxel
        source = _thinned(surface, _WIDE_VOXEL)
        for voxels, sigma in ((self._wide_map, 0.5 * _WIDE_VOXEL), (self._map, voxel)):
            pose = self._wide_registration.align_points_to_map(source, voxels, pose, 3 * sigma, sigma)
            source = _thinned(surface, 0.5 * voxel, 1.5 * voxel)
        return pose


def _thinned(surface: Surface, *voxels: float) -> NDArray[np.float64]:
    """Points (n, 3) float64 of the surface, one for each voxel of each size in turn."""
    points = surface.points[::_KISS_STRIDE].astype(np.float64)
    for voxel in voxels:
        points = voxel_down_sample(points, voxel)
    return points


def kiss_config(settings: PoseSettings) -> KISSConfig:
    """KISS-ICP's own configuration: each value that it reads is stated, so that its environment has no say.

    One thread: the stage's budget is one core, and the sums come out in the same order each time.
    """
    return KISSConfig(
        data={"max_range": settings.map_range, "min_range": 0.0, "deskew": False},
        mapping={
            "voxel_size": settings.kiss_voxel,
            "max_points_per_voxel": settings.kiss_points_per_voxel,
        },
        registration={
            "max_num_iterations": settings.kiss_iterations,
            "convergence_criterion": settings.kiss_convergence,
            "max_num_threads": 1,
        },
        adaptive_threshold={
            "fixed_threshold": None,
            "initial_threshold": settings.kiss_initial_threshold,
            "min_motion_th": settings.kiss_min_motion,
        },
    )
