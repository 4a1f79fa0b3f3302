"""The peer, a baseline beside ours in every table of objects: remove the plane, DBSCAN the rest, box the clusters.

It is the obvious first approach, in the same run and with the same poses. Where it is better, the tables say so.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

from spot3d.camera import Intrinsics, back_project
from spot3d.evaluate.dominant_plane import ON_PLANE, dominant_plane
from spot3d.evaluate.labelled import boxes_around
from spot3d.geometry.upright import upright_box

PEER = "plane + DBSCAN"
RADIUS = 0.02
"""Better than 3 cm on the learning splits of OSD (detection 0.86, not 0.85) and HOTS (0.84, not 0.80)."""
CORE = 5
"""Least voxels within the radius of a core point. With 10 the rates change by less than 0.01."""
RANGE_MAX = 2.5
"""Depth beyond this is dropped, metres. With 2.5, 3, 3.5 m: the peer's F on redkitchen 50, 38, 39."""
VOXEL = 0.005
VOXELS_MIN = 100
"""A smaller cluster is no object: 100 voxels of 5 mm are 25 cm2 of surface."""


def peer_in_frame(depth: NDArray[np.float32], camera: Intrinsics, size_max: float) -> NDArray[np.float64]:
    """2D boxes (n, 4) [x, y, w, h] around the pixels of each cluster above the dominant plane of one frame.

    depth: (h, w) float32 metres, 0 = invalid. The plane and everything beneath it are removed, and so are depth beyond
    `RANGE_MAX` and clusters whose upright box is longer than `size_max`, metres: fusion's limits, and the fused peer's.
    """
    points = back_project(depth, camera).reshape(-1, 3)
    pixels = np.flatnonzero((points[:, 2] > 0) & (points[:, 2] <= RANGE_MAX))
    if len(pixels) < VOXELS_MIN:
        return np.zeros((0, 4))
    plane = dominant_plane(points[pixels], np.zeros(3))
    pixels = pixels[points[pixels] @ plane[:3] + plane[3] > ON_PLANE]
    means, voxel = voxel_means(points[pixels], VOXEL)
    clusters = dbscan_clusters(means, VOXELS_MIN)
    sizes = (upright_box(means[rows].astype(np.float32), plane[:3]).size.max() for rows in clusters)
    kept = [rows for rows, size in zip(clusters, sizes, strict=True) if size <= size_max]
    return boxes_around(np.divmod(pixels[np.isin(voxel, rows)], camera.width) for rows in kept)


def dbscan_clusters(points: NDArray[np.float64], least: int) -> list[NDArray[np.int64]]:
    """Rows of each cluster of at least `least` of (n, 3) points, metres."""
    if not len(points):
        return []
    label = DBSCAN(eps=RADIUS, min_samples=CORE).fit_predict(points)
    size = np.bincount(label[label >= 0])
    return [np.flatnonzero(label == number) for number in np.flatnonzero(size >= least)]


def voxel_keys(points: NDArray[np.floating], voxel: float) -> NDArray[np.int64]:
    """(n,) int64, a key of the voxel of each of (n, 3) points, unique within 10 km of the origin at 1 cm."""
    i, j, k = (np.floor(points / voxel).astype(np.int64) + (1 << 20)).T
    return np.asarray((i << 42) | (j << 21) | k)


def voxel_means(points: NDArray[np.floating], voxel: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The mean (m, 3) of the points in each voxel, and the index (n,) of the voxel of each of the (n, 3) points."""
    _, of_point, count = np.unique(voxel_keys(points, voxel), return_inverse=True, return_counts=True)
    sums = [np.bincount(of_point, points[:, axis], minlength=len(count)) for axis in range(3)]
    return np.stack(sums, axis=1) / count[:, None], of_point.reshape(-1)


def behind_peer(where: str, measures: Sequence[tuple[str, float, float]]) -> list[str]:
    """A sentence on the measures (name, ours, the peer's; larger is better) in which the peer is ahead, if any.

    Values that round to the same two decimals are equal. Undefined ones (nothing found) count as 0.
    """
    worse = [
        f"{name} ({'-' if np.isnan(ours) else f'{ours:.2f}'}, it {theirs:.2f})"
        for name, ours, theirs in measures
        if round(float(np.nan_to_num(theirs)), 2) > round(float(np.nan_to_num(ours)), 2)
    ]
    return [f"Behind {PEER} in {', '.join(worse)} on {where}."] if worse else []
