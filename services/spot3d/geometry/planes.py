"""Dominant planes of a frame (paper, Sec. V-A)."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.geometry.upright import taken
from spot3d.kernel import kernel

_NEIGHBOUR_SHARE = 1 / 16
"""The points of a triple lie within this share of the image's width: 7 cm at 1 m, fifty times the noise there. The
paper does not say how near; between adjacent pixels, 2 mm apart, noise alone would determine the normal."""
_COARSE, _FINE = 200, 4000
"""Number of points on which all triples are scored, and then the best of them."""
_SHORTLIST = 50
"""Number of triples that are scored on the fine sample."""
_SPREAD = 0.2
"""Sine of the least angle between the two sides of a triple: noise turns the normal of a narrower one."""
_LEAST_SHARE = 0.02
"""A dominant plane holds at least this share of the valid points."""


class PlaneSettings(Protocol):
    """The settings about planes that a stage has."""

    @property
    def plane_distance(self) -> float:
        """eps_p: distance in metres within which a point lies on a plane."""

    @property
    def noise_gate(self) -> float:
        """That distance is never below this many standard deviations of the depth noise."""

    @property
    def plane_triples(self) -> int:
        """Triples of neighbouring pixels that RANSAC tries."""

    @property
    def plane_candidates(self) -> int:
        """Largest number of dominant planes of a frame."""


def plane_tolerance(
    depth: NDArray[np.float32], settings: PlaneSettings, noise: DepthNoise = KINECT_V1
) -> NDArray[np.float32]:
    """eps_p, or `noise_gate` deviations of the noise at that depth if more; in the shape of `depth`, both in metres."""
    gate = np.float32(settings.noise_gate) * noise.sigma(depth)
    return np.asarray(np.maximum(np.float32(settings.plane_distance), gate))


def dominant_planes(
    points: NDArray[np.float32],
    settings: PlaneSettings,
    rng: np.random.Generator,
    known: NDArray[np.float64] | None = None,
    noise: DepthNoise = KINECT_V1,
) -> NDArray[np.float64]:
    """The distinct planes with most inliers, by RANSAC over triples of neighbouring pixels (paper, Eq. 9).

    points: (h, w, 3) float32 metres, camera frame; z = 0 is invalid. known: (k, 4) planes expected here (those
    of earlier keyframes), which compete with a tenth of the usual number of triples.
    Returns (n, 4) float64 [n_x, n_y, n_z, b], n unit and towards the camera (b >= 0), n.x + b = 0 on the
    plane, most inliers first (each counted among the points that the planes before it leave), n <= `plane_candidates`.
    """
    flat = points.reshape(-1, 3)
    valid = np.flatnonzero(flat[:, 2] > 0)
    if len(valid) < 100:
        return np.zeros((0, 4))
    count = settings.plane_triples if known is None or len(known) == 0 else settings.plane_triples // 10
    planes, _ = triple_planes(points, neighbour_triples(points.shape, valid, count, rng), _SPREAD)
    if known is not None:
        planes = np.concatenate((known, planes))
    if len(planes) == 0:
        return planes
    sample = taken(flat, valid[rng.integers(0, len(valid), _FINE)])
    tolerance = plane_tolerance(sample[:, 2], settings, noise)
    distinct: list[NDArray[np.float64]] = []
    while len(distinct) < settings.plane_candidates and len(sample) > _FINE * _LEAST_SHARE:
        plane = _most_inliers(planes, sample, tolerance)
        distinct.append(refine_plane(plane, sample, tolerance))
        free = np.abs(sample @ distinct[-1][:3].astype(np.float32) + np.float32(distinct[-1][3])) >= tolerance
        if np.count_nonzero(~free) < _FINE * _LEAST_SHARE:
            distinct.pop()
            break
        sample, tolerance = taken(sample, np.flatnonzero(free)), tolerance[free]
    return np.array(distinct).reshape(-1, 4)


def _most_inliers(
    planes: NDArray[np.float64], points: NDArray[np.float32], tolerance: NDArray[np.float32]
) -> NDArray[np.float64]:
    """The plane with most inliers: all are scored on a few of the points, the best of them on all."""
    step = max(1, len(points) // _COARSE)
    few, few_tolerance = np.ascontiguousarray(points[::step]), np.ascontiguousarray(tolerance[::step])
    coarse = count_inliers(planes.astype(np.float32), few, few_tolerance)
    best = planes[np.argsort(-coarse.astype(np.int16), kind="stable")[:_SHORTLIST]]  # few bits are sorted fast
    fine = count_inliers(best.astype(np.float32), points, tolerance)
    return np.asarray(best[int(np.argmax(fine))])


def on_plane(
    plane: NDArray[np.float64], points: NDArray[np.float32], settings: PlaneSettings, noise: DepthNoise = KINECT_V1
) -> NDArray[np.bool_]:
    """Which valid points lie on the plane within the tolerance of their depth (paper, Eq. 9). Camera frame."""
    n = plane[:3].astype(np.float32)
    z = np.ascontiguousarray(points[..., 2])
    distance = np.abs(points @ n + np.float32(plane[3]))
    return np.asarray((distance < plane_tolerance(z, settings, noise)) & (z > 0))


def refine_plane(
    plane: NDArray[np.float64], points: NDArray[np.float32], tolerance: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Least squares on the inliers, each weighted by the inverse of its variance. points (n, 3), tolerance (n,)."""
    for _ in range(2):
        distance = np.abs(points @ plane[:3].astype(np.float32) + np.float32(plane[3]))
        inliers = np.flatnonzero(distance < tolerance)
        if len(inliers) < 3:
            return plane
        plane = fit_plane(taken(points, inliers), np.float32(1) / tolerance[inliers] ** 2, towards=plane[:3])
    return plane


def fit_plane(
    points: NDArray[np.float32], weights: NDArray[np.float32], towards: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted least-squares plane (4,) of (n, 3) points, its normal on the side of `towards`."""
    total = weights.sum(dtype=np.float64)
    mean = (weights @ points.astype(np.float64)) / total
    centred = points - mean
    covariance = (centred * weights[:, None]).T @ centred / total
    normal = np.linalg.eigh(covariance)[1][:, 0]
    if normal @ towards < 0:
        normal = -normal
    return np.append(normal, -normal @ mean)


def transform_plane(plane: NDArray[np.float64], T_target_source: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same plane (4,), or planes (n, 4), in the target frame: p' = p T^-1."""
    return np.asarray(plane @ np.linalg.inv(T_target_source))


def neighbour_triples(
    shape: tuple[int, ...], valid: NDArray[np.int64], count: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """(count, 3) flat pixel numbers: a random valid pixel and two others near it (perhaps invalid)."""
    h, w = shape[:2]
    reach = max(2, int(w * _NEIGHBOUR_SHARE))
    first = valid[rng.integers(0, len(valid), count)]
    v, u = np.divmod(first, w)
    dv, du = rng.integers(-reach, reach + 1, (2, 2, count))
    others = np.clip(v + dv, 0, h - 1) * w + np.clip(u + du, 0, w - 1)
    return np.stack((first, others[0], others[1]), axis=1)


def triple_planes(
    points: NDArray[np.float32], triples: NDArray[np.int64], spread: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Planes (n, 4) through triples (m, 3) of valid points, normals towards the camera; and a point (n, 3) of each.

    spread: sine of the least angle at the first of the points, below which they count as collinear.
    """
    corners = taken(points.reshape(-1, 3), triples.ravel()).reshape(-1, 9).T
    a, b, c = np.split(np.array(corners, np.float64, order="C"), 3)  # (3, m) each: coordinates are faster apart
    normals = np.cross(b - a, c - a, axis=0)
    length = np.linalg.norm(normals, axis=0)
    sides = np.linalg.norm(b - a, axis=0) * np.linalg.norm(c - a, axis=0)
    good = np.flatnonzero((a[2] > 0) & (b[2] > 0) & (c[2] > 0) & (length > spread * sides))
    a, normals = a[:, good], normals[:, good] / length[good]
    planes = np.vstack((normals, -np.einsum("im,im->m", normals, a)))
    planes *= np.where(planes[3] < 0, -1, 1)
    return np.ascontiguousarray(planes.T), a.T


def count_inliers(
    planes: NDArray[np.float32], points: NDArray[np.float32], tolerance: NDArray[np.float32]
) -> NDArray[np.int32]:
    """How many of (n, 3) points lie within their tolerance of each of (m, 4) planes: (m,) int32."""
    counts = np.empty(len(planes), np.int32)
    xs, ys, zs = np.ascontiguousarray(points.T)
    _count_inliers(planes, xs, ys, zs, tolerance, counts)
    return counts


@kernel("void(f4[:,::1], f4[::1], f4[::1], f4[::1], f4[::1], i4[::1])")
def _count_inliers(
    planes: NDArray[np.float32],
    xs: NDArray[np.float32],
    ys: NDArray[np.float32],
    zs: NDArray[np.float32],
    tolerance: NDArray[np.float32],
    counts: NDArray[np.int32],
) -> None:
    """See `count_inliers`; axis by axis, so that several points are computed at once."""
    for j in range(len(planes)):
        a, b, c, d = planes[j, 0], planes[j, 1], planes[j, 2], planes[j, 3]
        inliers = 0
        for i in range(len(xs)):
            inliers += abs(a * xs[i] + b * ys[i] + c * zs[i] + d) < tolerance[i]
        counts[j] = inliers
