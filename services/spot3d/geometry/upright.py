"""Upright boxes around clusters of points (paper, Sec. V-D, Eq. 16)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.geometry.footprint import footprint_yaw
from spot3d.geometry.quantiles import quantiles
from spot3d.kernel import kernel, part
from spot3d.trajectory import rotation_to_z

_SAMPLE = 1000
"""About this many points of a cluster determine its rough box."""
_STEEP = np.sin(np.radians(60))
"""Seen from more steeply above than this, an object shows less than half of the height of its sides and hides what it
stands on: a ball its lower half. With 53 and 64 degrees HOTS, OSD and near desks are the same."""


rotation_to_upright = kernel("f8[:,::1](f8[:])")(rotation_to_z)
"""Rotation R_upright_world (3, 3) that turns `up` (unit, world) into +z by the smallest angle (paper, Eq. 16).

The paper turns the normal into y; z is the robot world's up.
"""


@kernel("f8[:,::1](f4[:,::1], f8[:,:])")
def _turned(points: NDArray[np.float32], R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, n) float64: R times each of (n, 3) points."""
    turned = np.empty((3, len(points)))
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        for axis in range(3):
            turned[axis, i] = R[axis, 0] * x + R[axis, 1] * y + R[axis, 2] * z
    return turned


@part()
def _turn_level(columns: NDArray[np.float64], cosine: float, sine: float) -> None:
    """Turn (3, n) columns about z, in place, so that what lay in this direction lies along x."""
    for i in range(columns.shape[1]):
        x, y = columns[0, i], columns[1, i]
        columns[0, i], columns[1, i] = cosine * x + sine * y, cosine * y - sine * x


@kernel("f8[:,::1](f4[:,::1], f8[:], f8)")
def _enclosed(points: NDArray[np.float32], up: NDArray[np.float64], trim: float) -> NDArray[np.float64]:
    """Centre, size and rotation of the box around points (see `upright_box`), stacked: (5, 3)."""
    R = rotation_to_upright(up)
    upright = _turned(points, R)
    yaw = footprint_yaw(upright[:2])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    _turn_level(R, cosine, sine)
    _turn_level(upright, cosine, sine)
    ends, box = quantiles(upright, trim), np.zeros((5, 3))
    for axis in range(3):
        middle = (ends[0, axis] + ends[1, axis]) / 2
        box[1, axis] = ends[1, axis] - ends[0, axis]
        for k in range(3):
            box[0, k] += R[axis, k] * middle
            box[2 + k, axis] = R[axis, k]
    return box


def upright_box(points: NDArray[np.float32], up: NDArray[np.float64], trim: float = 0.0) -> Box3D:
    """The tight box of (n, 3) world points whose third axis is `up`, turned to the smallest footprint.

    trim: share of the points left out at each end of each axis, so that a few stray points do not stretch the box.
    Raises ValueError without points.
    """
    if len(points) == 0:
        raise ValueError("no points have no box")
    found = _enclosed(points, up, trim)
    return Box3D(found[0], found[1], found[2:])


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


def sampled(points: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """An evenly spread sample of these rows of (n, 3) points, enough for a rough box."""
    return taken(points, rows[:: max(1, len(rows) // _SAMPLE)])


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
