"""Renders a single frame, with its noise and holes, from other poses, as if its camera moved."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from spot3d.camera import back_project, invert
from spot3d.frame import RgbdFrame

VIEWS = 12
"""Four times the views that make an object (`fusion.views_min`)."""
INTERVAL_NS = 300_000_000
"""About the interval between keyframes."""
SWING = np.radians((4.5, 9.0))
"""Angles by which the camera swings up and down, and to each side, around the middle of its view: 13 cm at 0.85 m."""


def moved_views(frame: RgbdFrame) -> list[RgbdFrame]:
    """The frame, and views of the same scene from cameras on a figure of eight, with their poses.

    The frame's camera is the world. Where no pixel of the frame is visible, the other views have no depth and the
    colour beside it. A pixel without depth moves with the depth of the nearest pixel that has some.
    """
    depth = frame.depth_metres()
    measured = depth > 0
    filled = depth[_nearest(measured)] if measured.any() else np.ones_like(depth)
    points = back_project(filled, frame.intrinsics).reshape(-1, 3).astype(np.float64)
    middle = np.array((0.0, 0.0, float(np.median(depth[measured])) if measured.any() else 1.0))
    views = []
    for number in range(VIEWS):
        phase = 2 * np.pi * number / VIEWS
        turn = np.append(SWING * (np.sin(2 * phase), np.sin(phase)), 0.0)
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(turn)[0]
        pose[:3, 3] = middle - pose[:3, :3] @ middle
        seen = _seen_from(frame, points, measured.ravel(), pose) if number else replace(frame, T_world_camera=pose)
        views.append(replace(seen, stamp_ns=number * INTERVAL_NS))
    return views


def _seen_from(
    frame: RgbdFrame, points: NDArray[np.float64], measured: NDArray[np.bool_], T_world_camera: NDArray[np.float64]
) -> RgbdFrame:
    """The frame of a camera at this pose. Each point covers the four pixels around it; the nearest is visible.

    points: (n, 3) metres, the frame's pixels in its camera's frame; measured: (n,), which of them have depth.
    """
    camera, T = frame.intrinsics, invert(T_world_camera)
    h, w = camera.shape
    x, y, z = (points @ T[:3, :3].T + T[:3, 3]).T
    ahead = np.maximum(z, 1e-6)
    column = np.floor(camera.fx * x / ahead + camera.cx).astype(np.int64) + np.array([[0], [1], [0], [1]])
    row = np.floor(camera.fy * y / ahead + camera.cy).astype(np.int64) + np.array([[0], [0], [1], [1]])
    inside = (z > 0) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
    pixel, source = (row * w + column)[inside], np.nonzero(inside)[1]
    nearest = np.full(h * w, np.inf)
    np.minimum.at(nearest, pixel, z[source])
    seen = np.full(h * w, -1)
    foremost = z[source] <= nearest[pixel]
    seen[pixel[foremost]] = source[foremost]
    hit = (seen >= 0).reshape(h, w)
    if not hit.any():
        seen[:] = 0
    depth = np.where(hit, (z * measured)[seen].reshape(h, w), 0).astype(np.float32)
    colour = frame.colour.reshape(-1, 3)[seen].reshape(h, w, 3)
    if hit.any():
        colour = colour[_nearest(hit)]
    return replace(frame, colour=colour, depth=depth, depth_scale=1.0, T_world_camera=T_world_camera)


def _nearest(known: NDArray[np.bool_]) -> tuple[NDArray[np.int32], ...]:
    """Row and column of the nearest known pixel for each pixel of (h, w)."""
    return tuple(distance_transform_edt(~known, return_distances=False, return_indices=True))
