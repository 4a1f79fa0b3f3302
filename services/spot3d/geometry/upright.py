"""Upright boxes around clusters of points (paper, Sec. V-D, Eq. 16)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.geometry.quantiles import quantiles
from spot3d.kernel import kernel
from spot3d.trajectory import rotation_to_z

_STEEP = np.sin(np.radians(60))
"""Seen from more steeply above than this, an object shows less than half of the height of its sides and hides what it
stands on: a ball its lower half. With 53 and 64 degrees HOTS, OSD and near desks are the same."""


def upright_box(points: NDArray[np.float32], up: NDArray[np.float64], trim: float = 0.0) -> Box3D:
    """The tight box of (n, 3) world points whose third axis is `up`, turned to the smallest footprint.

    The paper turns the normal into y (Eq. 16); z is the robot world's up. trim: share of the points left out at each
    end of each axis, so that a few stray points do not stretch the box. Raises ValueError without points.
    """
    if len(points) == 0:
        raise ValueError("no points have no box")
    R = rotation_to_z(up)
    upright = R @ points.T
    # Relative to a point, as OpenCV has 24 bits only.
    footprint = np.ascontiguousarray((upright[:2] - upright[:2, :1]).T, np.float32)
    yaw = np.radians(cv2.minAreaRect(footprint)[2]) % (np.pi / 2)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
    low, high = quantiles(turn @ upright, trim, 1 - trim)
    axes = (turn @ R).T
    return Box3D(axes @ ((low + high) / 2), high - low, axes)


def are_below(towards: NDArray[np.floating], up: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) bool: whether the camera looks down on objects so steeply that they hide what they stand on.

    towards: (n, 3) vectors from them to the camera; up: (3,) unit; in the same frame.
    """
    return np.asarray(towards @ up > _STEEP * np.linalg.norm(towards, axis=1))


def with_bottom(box: Box3D, height: float) -> Box3D:
    """The same upright box with its bottom at `height` along its third axis (metres), its top unchanged."""
    up = box.rotation[:, 2]
    length, width, tall = box.size.tolist()
    middle = float(up @ box.centre)
    rest = max(0.0, middle + tall / 2 - height)
    return Box3D(box.centre + (tall - rest) / 2 * up, np.array([length, width, rest]), box.rotation)


@kernel("f4[:,::1](f4[:,:], i8[:])")
def taken(values: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """These rows of (n, 3) values, as from `take`, which is several times slower for rows this short."""
    found = np.empty((len(rows), 3), np.float32)
    for k in range(len(rows)):
        for axis in range(3):
            found[k, axis] = values[rows[k], axis]
    return found


def share_inside(points: NDArray[np.float32], box: Box3D, margin: float = 0.0) -> float:
    """Share of (n, 3) world points that lie in the box, or within `margin` metres of it along its axes."""
    return _share_inside(points, box.centre, box.rotation, box.size / 2 + margin)


@kernel("f8(f4[:,::1], f8[:], f8[:,:], f8[:])")
def _share_inside(
    points: NDArray[np.float32], centre: NDArray[np.float64], rotation: NDArray[np.float64], half: NDArray[np.float64]
) -> float:
    inside = 0
    for i in range(len(points)):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        within = True
        for axis in range(3):
            within &= abs(rotation[0, axis] * x + rotation[1, axis] * y + rotation[2, axis] * z) <= half[axis]
        inside += within
    return inside / len(points)
