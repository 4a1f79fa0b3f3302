"""Objects of one frame alone, without fusion over time (paper, Sec. V-A, RGBD scenes)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.fusion.density_frame import find_by_density_in_frame
from spot3d.fusion.extraction import find_clusters
from spot3d.fusion.selection import MapPoints
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.structure import StructurePlane
from spot3d.geometry.lattice import to_lattice
from spot3d.geometry.normals import surface_normals
from spot3d.geometry.planes import dominant_planes, supporting_plane
from spot3d.segments.hanging import join_hanging
from spot3d.segments.occlusion import join_occluded


@dataclass(frozen=True, slots=True)
class SingleFrame:
    """Objects of one frame. boxes: (n, 4) float64 [x, y, w, h] pixels around each object's pixels.

    labels: (h, w) int32, 0 = no object, k = object k - 1. support: (4,) plane on which they stand, camera frame, its
    normal towards the camera; None where there is none.
    """

    boxes: NDArray[np.float64]
    labels: NDArray[np.int32]
    support: NDArray[np.float64] | None = None


def find_in_frame(
    colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    heat: NDArray[np.uint8],
    camera: Intrinsics,
    settings: FusionSettings,
) -> SingleFrame:
    """Remove the supporting plane, cluster what is left and put 2D boxes around the clusters' pixels.

    colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths.
    """
    if settings.clustering == "density":
        return _boxed(find_by_density_in_frame(depth, heat, camera, settings), depth.shape)
    frame = to_lattice(colour, depth, heat, camera, camera.width)
    points = back_project(frame.depth, camera)
    planes = dominant_planes(points, settings, np.random.default_rng(settings.seed))
    chosen = supporting_plane(planes, points, heat, settings)
    if chosen is None:
        return _boxed([], depth.shape)
    pixels = np.flatnonzero((depth.ravel() > 0) & (depth.ravel() <= settings.range_max))
    normals = surface_normals(depth, camera)
    seen = MapPoints(
        points.reshape(-1, 3)[pixels],
        normals.reshape(-1, 3)[pixels],
        colour.reshape(-1, 3)[pixels].astype(np.float32),
        heat.ravel()[pixels].astype(np.float32) / np.float32(255),
        np.ones(len(pixels), np.float32),
    )
    structure = [StructurePlane(chosen[0], 1.0, chosen[1])]
    structure += [StructurePlane(plane, 0.0, 0.0) for plane in planes if not np.array_equal(plane, chosen[0])]
    # A part may be too cold alone and yet belong to an object that is not.
    lenient = settings.model_copy(update={"heat_min": settings.heat_min / 2})
    clusters = [pixels[cluster.rows] for cluster in find_clusters(seen, structure, lenient)]
    clusters = join_hanging(clusters, points, chosen[0][:3])
    clusters = join_occluded(clusters, points, normals, chosen[0][:3])
    clusters = [cluster for cluster in clusters if heat.ravel()[cluster].mean() >= 255 * settings.heat_min]
    return replace(_boxed(clusters, depth.shape), support=chosen[0])


def _boxed(clusters: list[NDArray[np.int64]], shape: tuple[int, ...]) -> SingleFrame:
    """The frame, of this shape, with a label for each cluster of flat pixel numbers and a box around it."""
    boxes, labels = np.zeros((len(clusters), 4)), np.zeros(shape, np.int32)
    for number, cluster in enumerate(clusters):
        v, u = np.divmod(cluster, shape[1])
        boxes[number] = u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1
        labels.ravel()[cluster] = number + 1
    return SingleFrame(boxes, labels)
