"""Generalised ICP to a voxel map of Gaussians, by small_gicp (Koide 2024); an optional extra."""

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.registration import DISTANCE, RECOVERY_DISTANCE, Registration, judged
from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import VOXEL, SurfelMap

try:
    import small_gicp
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "pose provider 'gicp' needs the package small_gicp: pip install 'spot3d[gicp]'", name="small_gicp"
    ) from error

_NEIGHBOURS = 10
# Voxels of the source points and of the map of Gaussians, and largest correspondence distance, metres.
_SOURCE_VOXEL, _VOXEL, _DISTANCE = 0.03, 0.08, 0.10
_ITERATIONS = 20
# The map that a poor guess is first registered to has voxels this many times larger.
_COARSE = 4
# A voxel that was not seen for this many frames is removed; the map looks for such voxels every so many frames.
_HORIZON, _CLEAR_CYCLE = 3000, 100


class SmallGicp:
    """Registers denoised surface points to Gaussians, one for each voxel."""

    def __init__(self, surfel_limit: int) -> None:
        self._empty_maps()
        # Judges registrations, by the same measure as the other provider's.
        self.planes = SurfelMap(VOXEL, surfel_limit, beside=False)
        # The cloud of the current surface: a frame may be registered several times, and is then inserted.
        self._prepared: tuple[Surface, small_gicp.PointCloud] | None = None

    def register(self, surface: Surface, T_world_guess: NDArray[np.float64], wide: bool) -> Registration:
        """Generalised ICP from the guess; `wide` registers to the coarse map first."""
        source = self._source(surface)
        pose = T_world_guess
        if wide:
            pose = self._align(self._coarse_map, source, pose, _COARSE * _DISTANCE)
        pose = self._align(self._map, source, pose, _DISTANCE)
        return judged(self.planes, surface, pose, RECOVERY_DISTANCE if wide else DISTANCE)

    def insert(self, surface: Surface, T_world_camera: NDArray[np.float64]) -> None:
        """Add an accepted frame to every map."""
        source = self._source(surface)
        self._map.insert(source, T_world_camera)
        self._coarse_map.insert(source, T_world_camera)
        self.planes.insert(surface, T_world_camera)

    def restored(self) -> None:
        """Rebuild the maps of Gaussians from the positions of the surfels."""
        self._empty_maps()
        places = self.planes.held()[1][:, :3]
        if len(places) > _NEIGHBOURS:
            cloud = self._cloud(places)
            self._map.insert(cloud, np.eye(4))
            self._coarse_map.insert(cloud, np.eye(4))

    def _empty_maps(self) -> None:
        self._map = small_gicp.GaussianVoxelMap(_VOXEL)
        self._coarse_map = small_gicp.GaussianVoxelMap(_COARSE * _VOXEL)
        for voxels in (self._map, self._coarse_map):
            voxels.set_lru(_HORIZON, _CLEAR_CYCLE)

    def _source(self, surface: Surface) -> "small_gicp.PointCloud":
        if self._prepared is None or self._prepared[0] is not surface:
            self._prepared = (surface, self._cloud(surface.points.astype(np.float64)))
        return self._prepared[1]

    def _cloud(self, points: NDArray[np.float64]) -> "small_gicp.PointCloud":
        cloud, _ = small_gicp.preprocess_points(
            points, downsampling_resolution=_SOURCE_VOXEL, num_neighbors=_NEIGHBOURS, num_threads=1
        )
        return cloud

    def _align(
        self,
        voxels: "small_gicp.GaussianVoxelMap",
        source: "small_gicp.PointCloud",
        guess: NDArray[np.float64],
        distance: float,
    ) -> NDArray[np.float64]:
        result = small_gicp.align(
            voxels, source, guess, max_correspondence_distance=distance, num_threads=1, max_iterations=_ITERATIONS
        )
        return np.array(result.T_target_source)
