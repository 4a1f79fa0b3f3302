"""World geometry for the view: rotations as quaternions, the camera's path, and patches of supporting planes."""

import numpy as np
from numpy.typing import NDArray

from spot3d.trajectory import quaternion_from_rotation

_STEP_M = 0.02
"""Least distance between corners of the path."""
_CORNERS = 2000
_NEAR_M = 0.015
"""Points within this of a plane lie on it."""
_SAMPLE = 60_000
_PATCH_POINTS = 200
"""Fewest points on a plane that is shown."""
_LIFT_M = 0.005
"""Height of a patch above its plane, so that the points do not hide it."""
_PATCH_SHARE = 0.04
"""Share of the points left out on each side of a patch: distant points that the plane cuts are not part of it."""


def quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4,) unit quaternion of a rotation matrix (3, 3) in viser's order: w, x, y, z."""
    return np.roll(quaternion_from_rotation(rotation), 1)


class Trail:
    """The camera's path, thinned: at most 2000 corners, of which every second goes when there are more."""

    def __init__(self) -> None:
        self._corners: list[NDArray[np.float64]] = []
        self._step_m = _STEP_M

    def add(self, place: NDArray[np.float64]) -> None:
        """Add the camera's place (3,), world, as a corner, unless it is near the last one."""
        if self._corners and np.linalg.norm(place - self._corners[-1]) < self._step_m:
            return
        self._corners.append(np.array(place, np.float64))
        if len(self._corners) > _CORNERS:
            self._corners = self._corners[::2]
            self._step_m *= 2

    def segments(self) -> NDArray[np.float32]:
        """(n, 2, 3) float32 pieces of the path from corner to corner."""
        corners = np.array(self._corners, np.float32).reshape(-1, 3)
        return np.stack((corners[:-1], corners[1:]), axis=1)


def plane_patches(planes: NDArray[np.float64], xyz: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """For each plane with enough points on it, the corners (4, 3) of a rectangle in it that covers these points.

    planes: (p, 4) [n_x, n_y, n_z, b], n.x + b = 0; xyz: (n, 3) m, the same frame, of which a sample is used.
    """
    sample = xyz[:: max(1, len(xyz) // _SAMPLE)]
    patches = (_patch(plane, sample) for plane in planes)
    return [corners for corners in patches if corners is not None]


def _patch(plane: NDArray[np.float64], xyz: NDArray[np.float32]) -> NDArray[np.float32] | None:
    normal = plane[:3].astype(np.float32)
    near = xyz[np.abs(xyz @ normal + np.float32(plane[3])) < _NEAR_M]
    if len(near) < _PATCH_POINTS:
        return None
    across = np.linalg.svd(plane[None, :3])[2][1:].astype(np.float32)
    flat = near @ across.T
    # Along the points' principal axes, as tables are seldom aligned with the world's.
    axes = np.linalg.eigh(np.cov(flat[:: max(1, len(flat) // 5000)].T))[1].astype(np.float32)
    (a, b), (c, d) = np.quantile(flat @ axes, (_PATCH_SHARE, 1 - _PATCH_SHARE), axis=0)
    corners = np.array([(a, b), (c, b), (c, d), (a, d)], np.float32) @ axes.T @ across
    return np.asarray(corners + np.float32(_LIFT_M - plane[3]) * normal, np.float32)
