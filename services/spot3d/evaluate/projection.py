"""2D boxes of 3D objects in a view: around the projections of their points (paper, Sec. VI-B)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics, invert

NEAR = 0.1
VISIBLE_MIN = 0.5
"""An object is in a view if at least this share of its points is inside the image."""
POINTS_MAX = 2000
STEPS = 17
"""Points along each edge of a box. Where the image border cuts an edge, the 2D box ends within a sixteenth of it."""


def box_surface(box: Box3D) -> NDArray[np.float64]:
    """A grid of (n, 3) world points on the box's surface, for boxes without labelled points."""
    steps = np.linspace(-0.5, 0.5, STEPS)
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    grid = grid[(np.abs(grid) == 0.5).any(axis=1)]
    return np.asarray(box.centre + (grid * box.size) @ box.rotation.T, dtype=np.float64)


def thinned(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """At most 2000 of (n, 3) points, evenly chosen, and in addition the extremes along each axis."""
    if len(points) <= POINTS_MAX:
        return points.astype(np.float64)
    extremes = np.concatenate((points.argmin(axis=0), points.argmax(axis=0)))
    rows = np.concatenate((np.arange(0, len(points), -(-len(points) // POINTS_MAX)), extremes))
    return np.asarray(points[rows], dtype=np.float64)


def measured_at(
    points: NDArray[np.floating], depth: NDArray[Any], camera: Intrinsics
) -> tuple[NDArray[np.floating], NDArray[Any]]:
    """Depth (k,) of those of (n, 3) camera points that fall into the image, and the values of (h, w) `depth` there.

    Points nearer than 10 cm are dropped.
    """
    x, y, z = points[points[:, 2] > NEAR].T
    u = np.rint(x / z * camera.fx + camera.cx).astype(np.int64)
    v = np.rint(y / z * camera.fy + camera.cy).astype(np.int64)
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return z[inside], depth[v[inside], u[inside]]


def boxes_in_view(
    objects: Sequence[NDArray[np.float64]], T_world_camera: NDArray[np.float64], camera: Intrinsics
) -> NDArray[np.float64]:
    """Boxes (m, 4) [x, y, w, h] pixels of the objects, (n, 3) world points each, that are in the view.

    Boxes are cut at the image border. As in the paper, occlusion does not count.
    """
    T = invert(T_world_camera)
    boxes = []
    for points in objects:
        if not len(points):
            continue
        local = points @ T[:3, :3].T + T[:3, 3]
        local = local[local[:, 2] > NEAR]
        u = local[:, 0] / local[:, 2] * camera.fx + camera.cx
        v = local[:, 1] / local[:, 2] * camera.fy + camera.cy
        inside = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
        if np.count_nonzero(inside) < VISIBLE_MIN * len(points):
            continue
        u, v = u[inside], v[inside]
        # Boxes are measured from a pixel's corner, half a pixel from its centre.
        boxes.append((u.min() + 0.5, v.min() + 0.5, np.ptp(u), np.ptp(v)))
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
