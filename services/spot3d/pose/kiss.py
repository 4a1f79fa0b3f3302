"""KISS-ICP (Vizzo et al. 2023) with a preset for depth cameras, refined against a local map of planes.

KISS-ICP's point-to-point registration finds the pose from a poor guess; point-to-plane to averaged surfels then
refines it. Alone, the first is coarse on depth cameras and the second loses fast motion.
"""

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.mapping import get_voxel_hash_map
from kiss_icp.registration import get_registration
from kiss_icp.threshold import get_threshold_estimator
from kiss_icp.voxelization import voxel_down_sample
from numpy.typing import NDArray

from spot3d.camera import invert
from spot3d.pose.registration import RECOVERY_DISTANCE, Registration, judged, refined
from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import VOXEL, SurfelMap

# KISS-ICP thins its points to a few hundred anyway; a quarter of the lattice is plenty to choose from.
_KISS_STRIDE = 4
# Voxel in metres, points in a voxel, iterations at most, and the step that ends them (metres and radians).
_VOXEL, _POINTS = 0.10, 3
_ITERATIONS, _CONVERGENCE = 10, 3e-3
# After a loss KISS-ICP runs first against a map of larger voxels, since its search spans neighbouring voxels
# only. Voxel in metres, points in a voxel; sigma is half a voxel, so that correspondences reach 1.5 voxels.
_WIDE_VOXEL, _WIDE_POINTS = 0.3, 10
_WIDE_ITERATIONS, _WIDE_CONVERGENCE = 50, 1e-3
# Points farther than this from the camera are removed from the maps, metres.
_RANGE = 20.0
# sigma_0, the first adaptive threshold, and delta_min: smaller deviations do not adapt it; metres.
_FIRST_THRESHOLD, _MOTION_MIN = 0.05, 0.005


class KissIcp:
    """KISS-ICP and the refinement, with their local maps."""

    def __init__(self, surfel_limit: int) -> None:
        config = kiss_config(_VOXEL, _POINTS, _ITERATIONS, _CONVERGENCE)
        self._registration = get_registration(config)
        self._threshold = get_threshold_estimator(config)
        self._map = get_voxel_hash_map(config)
        wide_config = kiss_config(_WIDE_VOXEL, _WIDE_POINTS, _WIDE_ITERATIONS, _WIDE_CONVERGENCE)
        self._wide_registration = get_registration(wide_config)
        self._wide_map = get_voxel_hash_map(wide_config)
        self.planes = SurfelMap(VOXEL, surfel_limit, beside=False)
        self._deviation: NDArray[np.float64] | None = None

    def register(self, surface: Surface, T_world_guess: NDArray[np.float64], wide: bool) -> Registration:
        """KISS-ICP from the guess, then Gauss-Newton against the plane map."""
        if wide:
            self._deviation = None
            pose = refined(self.planes, surface, self._align_wide(surface, T_world_guess))
            return judged(self.planes, surface, pose, RECOVERY_DISTANCE)
        sigma = self._threshold.get_threshold()
        source = _thinned(surface, 0.5 * _VOXEL, 1.5 * _VOXEL)
        pose = self._registration.align_points_to_map(source, self._map, T_world_guess, 3 * sigma, sigma)
        pose = refined(self.planes, surface, pose)
        self._deviation = invert(T_world_guess) @ pose
        return judged(self.planes, surface, pose)

    def insert(self, surface: Surface, T_world_camera: NDArray[np.float64]) -> None:
        """Add an accepted frame to every map; its distance from the prediction adapts the threshold."""
        if self._deviation is not None:
            self._threshold.update_model_deviation(self._deviation)
        self._map.update(_thinned(surface, 0.5 * _VOXEL), T_world_camera)
        self._wide_map.update(_thinned(surface, 0.5 * _WIDE_VOXEL), T_world_camera)
        self.planes.insert(surface, T_world_camera)

    def restored(self) -> None:
        """Rebuild KISS-ICP's own maps from the positions of the surfels."""
        places = self.planes.held()[1][:, :3]
        for voxels in (self._map, self._wide_map):
            voxels.clear()
            voxels.add_points(places)
        self._deviation = None

    def _align_wide(self, surface: Surface, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """KISS-ICP from a poor guess: first against the map of larger voxels."""
        source = _thinned(surface, _WIDE_VOXEL)
        for voxels, sigma in ((self._wide_map, 0.5 * _WIDE_VOXEL), (self._map, _VOXEL)):
            pose = self._wide_registration.align_points_to_map(source, voxels, pose, 3 * sigma, sigma)
            source = _thinned(surface, 0.5 * _VOXEL, 1.5 * _VOXEL)
        return pose


def _thinned(surface: Surface, *voxels: float) -> NDArray[np.float64]:
    """Points (n, 3) float64 of the surface, one for each voxel of each size in turn."""
    points = surface.points[::_KISS_STRIDE].astype(np.float64)
    for voxel in voxels:
        points = voxel_down_sample(points, voxel)
    return points


def kiss_config(voxel: float, points: int, iterations: int, convergence: float) -> KISSConfig:
    """KISS-ICP's own configuration: each value that it reads is set, so that its environment has no effect.

    One thread: the stage's budget is one core, and sums are computed in the same order each time.
    """
    return KISSConfig(
        data={"max_range": _RANGE, "min_range": 0.0, "deskew": False},
        mapping={"voxel_size": voxel, "max_points_per_voxel": points},
        registration={"max_num_iterations": iterations, "convergence_criterion": convergence, "max_num_threads": 1},
        adaptive_threshold={
            "fixed_threshold": None,
            "initial_threshold": _FIRST_THRESHOLD,
            "min_motion_th": _MOTION_MIN,
        },
    )
