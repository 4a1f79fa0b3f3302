"""The peer on the fused cloud: voxels of the frames' points, planes removed, DBSCAN, upright boxes."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.evaluate.dominant_plane import dominant_plane
from spot3d.evaluate.judgement import Found
from spot3d.evaluate.peer import RANGE_MAX, dbscan_clusters, voxel_keys
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.upright import upright_box

FRAMES_MAX = 300
"""Most frames of a run, evenly spread, that are used: they are enough for a cloud and cost little."""
VOXEL = 0.01
SAMPLES = 320
"""About this many points are sampled across a frame: at 1 m they are 3.4 mm apart, less than a voxel's width."""
PLANES, PLANE_SHARE = 5, 0.05
"""Most planes to remove, as many as the paper's candidates, and the least share of the cloud on each of them."""
ON_PLANE = 0.015
"""Metres: fused layers are thicker than a frame's. The best of 1, 1.5, 2 cm over redkitchen, fr3/cabinet and scenes."""
VOXELS_MIN = 25
"""The same surface as on a single frame: 25 voxels of 1 cm are 25 cm2."""
_MERGED_AT = 50

Cells = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]
"""For each voxel: its key (n,), the sum and number of its points (n, 4), the number of frames that hit it (n,)."""


class PeerMap:
    """Voxels of the frames' points by the poses of a run, with the number of frames that hit each."""

    def __init__(self, frames: int) -> None:
        """frames: how many will be added. At most about 300 of them are used, evenly spread."""
        self._step = max(1, -(-frames // FRAMES_MAX))
        self._offered = self.frames_taken = 0
        self._eye = np.zeros(3)
        self._pending: list[Cells] = [(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, np.int64))]

    def add(self, depth: NDArray[np.float32], camera: Intrinsics, T_world_camera: NDArray[np.float64]) -> None:
        """Offer a frame. depth: (h, w) float32 metres, 0 = invalid."""
        self._offered += 1
        if (self._offered - 1) % self._step:
            return
        self.frames_taken += 1
        step = max(1, round(camera.width / SAMPLES))
        local = back_project(depth, camera)[::step, ::step].reshape(-1, 3)
        local = local[(local[:, 2] > 0) & (local[:, 2] <= RANGE_MAX)].astype(np.float64)
        world = local @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
        self._eye += T_world_camera[:3, 3]
        ones = np.ones(len(world))
        once = _merged(voxel_keys(world, VOXEL), np.column_stack((world, ones)), np.zeros(len(world), np.int64))
        self._pending.append((once[0], once[1], np.ones(len(once[0]), np.int64)))
        if len(self._pending) >= _MERGED_AT:
            self._pending = [self._all()]

    def found(self, settings: FusionSettings) -> Found:
        """Upright boxes around the clusters within the size limits of `settings`, with their points."""
        _, sums, hits = self._all()
        # Hit by as many frames as the paper asks of its points.
        kept = sums[hits >= min(settings.frequency_min, settings.frequency_share * self.frames_taken)]
        points = kept[:, :3] / kept[:, 3:]
        up, cloud = np.array((0.0, 0.0, 1.0)), len(points)
        for number in range(PLANES):
            if len(points) < VOXELS_MIN:
                break
            plane = dominant_plane(points, self._eye / self.frames_taken, ON_PLANE)
            off = np.abs(points @ plane[:3] + plane[3]) > ON_PLANE
            if np.count_nonzero(~off) < PLANE_SHARE * cloud:
                break
            points, up = points[off], plane[:3] if number == 0 else up
        boxes, inside = [], []
        for rows in dbscan_clusters(points, VOXELS_MIN):
            box = upright_box(points[rows].astype(np.float32), up)
            _, middle, longest = np.sort(box.size)
            if middle >= settings.size_min and longest <= settings.size_max and box.volume >= settings.volume_min:
                boxes.append(box)
                inside.append(points[rows])
        return Found(tuple(boxes), tuple(inside))

    def _all(self) -> Cells:
        keys, sums, hits = (np.concatenate(parts) for parts in zip(*self._pending, strict=True))
        return _merged(keys, sums, hits)


def _merged(keys: NDArray[np.int64], sums: NDArray[np.float64], hits: NDArray[np.int64]) -> Cells:
    """Sums the entries of each key."""
    different, entry = np.unique(keys, return_inverse=True)
    entry, count = entry.reshape(-1), len(different)
    added = np.stack([np.bincount(entry, column, minlength=count) for column in sums.T], axis=1).astype(np.float64)
    return different, added, np.bincount(entry, hits, minlength=count).astype(np.int64)
