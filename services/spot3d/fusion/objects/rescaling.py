"""What keyframes saw, had their depth been longer or shorter: the depth's scale is known better as a run goes on."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import View


def rescaled_view(view: View, factor: float) -> View:
    """The view with its depth times `factor`."""
    millimetres = np.rint(view.depth * factor)
    depth = np.where(millimetres < 65536, millimetres, 0).astype(np.uint16)
    camera = camera_of(view)
    centre = (camera + factor * (view.centre - camera)).astype(np.float32)
    return replace(view, depth=depth, centre=centre, reach=view.reach * factor)


def rescale_segments(
    segments: SegmentTable, rows: NDArray[np.int64], camera: NDArray[np.float64], factor: float
) -> None:
    """Put segments of one keyframe where depth times `factor` has them, seen from its camera, (3,) world."""
    spheres, support = segments.spheres.rows, segments.support.rows
    for points in (segments.places.rows, segments.outline.rows):
        points[rows] = camera + factor * (points[rows] - camera)
    spheres[rows, :3] = camera + factor * (spheres[rows, :3] - camera)
    spheres[rows, 3] *= factor
    # Zeros, of a segment that stands on nothing, stay zeros.
    away = support[rows, :3] @ camera
    support[rows, 3] = factor * (support[rows, 3] + away) - away


def camera_of(view: View) -> NDArray[np.float64]:
    """Where the view's camera is, (3,) in the views' world."""
    pose = view.pose.astype(np.float64)
    return np.asarray(-pose[:, :3].T @ pose[:, 3])
