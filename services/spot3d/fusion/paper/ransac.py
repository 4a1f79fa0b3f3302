"""The dominant planes of a frame through triples of its points, by the paper's method (Sec. V-A)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.planes import count_inliers, neighbour_triples, triple_planes

_SAME_ANGLE, _SAME_DISTANCE = float(np.cos(np.deg2rad(10.0))), 0.05
"""Planes that differ by less, in angle and in metres at the triple's first point, are not distinct; the paper does not
define it. Noise turns a triple by a few degrees, and a surface's noise at 3 m and more reaches over some
centimetres."""


def planes_by_ransac(
    points: NDArray[np.float32], settings: FusionSettings, rng: np.random.Generator
) -> NDArray[np.float64]:
    """The five distinct planes with most inliers among those through 10,000 triples of neighbouring points.

    points: (h, w, 3) float32 metres, camera frame; z = 0 is invalid. Each plane is counted on all points (paper,
    Eq. 9) and is not fitted to its inliers. Returns (n, 4) float64 [n_x, n_y, n_z, b], n unit and towards the camera
    (b >= 0), n.x + b = 0 on the plane, most inliers first, n <= `plane_candidates`.
    """
    flat = points.reshape(-1, 3)
    valid = np.flatnonzero(flat[:, 2] > 0)
    if len(valid) == 0:
        return np.zeros((0, 4))
    planes, x1 = triple_planes(points, neighbour_triples(points.shape, valid, settings.plane_triples, rng), 0.0)
    tolerance = np.full(len(valid), settings.plane_distance, np.float32)
    inliers = count_inliers(planes.astype(np.float32), flat[valid], tolerance)
    return _distinct(planes, x1, inliers, settings.plane_candidates)


def _distinct(
    planes: NDArray[np.float64], x1: NDArray[np.float64], inliers: NDArray[np.int32], most: int
) -> NDArray[np.float64]:
    """At most `most` of (n, 4) planes, those with most inliers first, without near duplicates.

    x1: (n, 3), a point of each plane.
    """
    distinct: list[NDArray[np.float64]] = []
    left = np.ones(len(planes), np.bool_)
    while len(distinct) < most and left.any():
        best = planes[np.argmax(np.where(left, inliers, -1))]
        turned = planes[:, :3] @ best[:3] < _SAME_ANGLE
        apart = np.abs(x1 @ best[:3] + best[3]) > _SAME_DISTANCE
        left &= turned | apart
        distinct.append(best)
    return np.array(distinct).reshape(-1, 4)
