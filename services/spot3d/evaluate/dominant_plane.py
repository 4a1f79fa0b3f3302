"""The plane with most points of a cloud, by RANSAC. Used by the peer and the data sets' readers, not by the method."""

import numpy as np
from numpy.typing import NDArray

ON_PLANE = 0.01
"""Points within this distance lie on a plane, metres: three sigma of a Kinect's depth at 1.4 m (depth_noise.KINECT_V1).
"""
_TRIPLES = 1000
"""Number of random triples: with a probability of 0.9997, one of them is on a plane that has a fifth of the points."""
_SAMPLE = 4000
"""Number of points on which the triples are scored: shares are accurate to 0.8 %."""
_REFITS = 3
"""Least-squares fits to all points near the plane, which remove the noise of the triple."""


def dominant_plane(
    xyz: NDArray[np.floating], towards: NDArray[np.float64], tolerance: float = ON_PLANE
) -> NDArray[np.float64]:
    """The plane with most of (n, 3) points, n >= 3: (4,) float64, unit normal and offset, n.x + b = 0 on it.

    The normal points to the side of `towards` (3,). Points within `tolerance` lie on a plane. All metres, in one frame.
    The result is deterministic.
    """
    rng = np.random.default_rng(0)
    sample = xyz[rng.permutation(len(xyz))[:_SAMPLE]].astype(np.float64)
    a, b, c = sample[rng.integers(0, len(sample), (3, _TRIPLES))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    offsets = np.where(length[:, 0] > 0, -np.einsum("ij,ij->i", normals, a), np.inf)
    planes = np.column_stack((normals, offsets))
    best = int(np.argmax([np.count_nonzero(np.abs(sample @ plane[:3] + plane[3]) < tolerance) for plane in planes]))
    normal, middle = planes[best, :3], sample.mean(axis=0)
    if not np.isfinite(planes[best, 3]):
        normal = np.array((0.0, 0.0, 1.0))  # every triple is collinear: there is no plane
    else:
        middle = -planes[best, 3] * normal
        for _ in range(_REFITS):
            near = xyz[np.abs((xyz - middle) @ normal) < tolerance].astype(np.float64)
            if len(near) < 3:
                break
            middle = near.mean(axis=0)
            normal = np.linalg.eigh(np.cov((near - middle).T))[1][:, 0]
    normal = normal if normal @ (towards - middle) >= 0 else -normal
    return np.append(normal, -normal @ middle)
