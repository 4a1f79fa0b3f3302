"""Objects of a single frame by the paper's method: no fusion, the rest as in Sec. V (paper, Sec. VI-A)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics, back_project
from spot3d.fusion.paper.density import cluster_by_density
from spot3d.fusion.paper.ransac import planes_by_ransac
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supporting_plane import supporting_plane
from spot3d.geometry.planes import on_plane

_ROUNDING = 1e-5
"""Margin, metres: the points at which a box ends belong to it, whatever the rounding."""


def find_by_density_in_frame(
    depth: NDArray[np.float32], heat: NDArray[np.uint8], camera: Intrinsics, settings: FusionSettings
) -> list[NDArray[np.int64]]:
    """Remove the supporting plane, cluster the hot points, and take the pixels of all points in each cluster's 3D box.

    depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths. Hot points have H_2D >= eps: the paper does
    not define them for single frames, where there is no frequency to average by. Returns each object's flat pixel
    numbers.
    """
    points = back_project(depth, camera)
    planes = planes_by_ransac(points, settings, np.random.default_rng(settings.seed))
    support = supporting_plane(planes, points, heat, settings, camera.noise)
    if support is None:
        return []
    top = (heat.ravel() >= 255 * settings.heat_min) & (depth.ravel() > 0)
    if settings.plane_removal:
        top &= ~on_plane(support, points, settings, camera.noise).ravel()
    seen = np.flatnonzero(depth.ravel() > 0)
    xyz = points.reshape(-1, 3)
    clusters, _ = cluster_by_density(xyz[np.flatnonzero(top)], support[:3], settings)
    return [seen[_inside(xyz[seen], box)] for _, box in clusters]


def _inside(xyz: NDArray[np.float32], box: Box3D) -> NDArray[np.bool_]:
    """Which of (n, 3) points lie in the box."""
    along = np.abs((xyz - box.centre) @ box.rotation)
    return np.asarray(np.all(along <= box.size / 2 + _ROUNDING, axis=1))
