"""From ranked points to objects as the paper has it: plane clean-up, density clustering, upright boxes (Sec. V-D)."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.fusion.map.selection import FrequentPoints
from spot3d.fusion.objects.reasons import TOO_SMALL
from spot3d.fusion.settings import FusionSettings
from spot3d.trajectory import rotation_to_z

_SAME_PLANE = 0.1
"""K-means has the fewest clusters whose planes are all this near to the centre in n, 6 degrees, and b, metres."""


def find_by_density(
    points: FrequentPoints, keyframe_planes: NDArray[np.float64], settings: FusionSettings
) -> tuple[list[FoundObject], NDArray[np.float64], Counter[str]]:
    """The objects among the map's frequent points, up, and the number of candidates left out, by reason.

    Objects: most confident first, not yet numbered; up: (3,) unit. keyframe_planes: (k, 4) float64, world, the plane
    that each keyframe removed: the paper's matrix P*. Without any there are no objects, as up is unknown.
    """
    if len(keyframe_planes) == 0:
        return [], np.array([0.0, 0.0, 1.0]), Counter()
    removed = unique_planes(keyframe_planes)
    up = up_direction(removed[0], points.xyz, settings)
    top = np.flatnonzero(points.heat >= settings.heat_min)
    if settings.plane_removal:
        top = top[~on_planes(points.xyz[top], removed, settings)]
    clusters, too_small = cluster_by_density(points.xyz[top], up, settings)
    found = [_described(points, top[rows], box) for rows, box in clusters]
    return sorted(found, key=lambda item: -item.confidence), up, +Counter({TOO_SMALL: too_small})


def unique_planes(keyframe_planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distinct planes (walls, floor, table) among those of the keyframes, by K-means over their parameters.

    keyframe_planes: (k, 4) float64, world, k > 0. Returns (n, 4), that of most keyframes first: the mean of each
    cluster. The paper does not give the
    number of clusters: here it is the least for which each holds one plane (`_SAME_PLANE`).
    """
    from sklearn.cluster import KMeans  # slow to import, and used by the paper's way alone

    for clusters in range(1, len(keyframe_planes) + 1):
        means = KMeans(clusters, n_init=1, random_state=0).fit(keyframe_planes)
        centres, labels = means.cluster_centers_.astype(np.float64), means.labels_
        off = keyframe_planes - centres[labels]
        if max(np.linalg.norm(off[:, :3], axis=1).max(), np.abs(off[:, 3]).max()) <= _SAME_PLANE:
            break
    centres /= np.linalg.norm(centres[:, :3], axis=1, keepdims=True)
    return np.asarray(centres[np.argsort(-np.bincount(labels, minlength=len(centres)), kind="stable")])


def up_direction(plane: NDArray[np.float64], xyz: NDArray[np.float32], settings: FusionSettings) -> NDArray[np.float64]:
    """The normal of the supporting plane (4,), (3,) unit, fitted to the map's (n, 3) points on it.

    The supporting plane is the one that most keyframes removed.
    """
    inliers = xyz[on_planes(xyz, plane[None], settings)].astype(np.float64)
    if len(inliers) < 3:
        return plane[:3]
    normal: NDArray[np.float64] = np.linalg.eigh(np.cov(inliers.T))[1][:, 0]
    return normal if normal @ plane[:3] > 0 else -normal


def on_planes(xyz: NDArray[np.float32], planes: NDArray[np.float64], settings: FusionSettings) -> NDArray[np.bool_]:
    """Which of (n, 3) points lie on any of (k, 4) planes, all in one frame (paper, Eq. 9)."""
    on = np.zeros(len(xyz), np.bool_)
    for plane in planes.astype(np.float32):
        on |= np.abs(xyz @ plane[:3] + plane[3]) < settings.plane_distance
    return on


def cluster_by_density(
    xyz: NDArray[np.float32], up: NDArray[np.float64], settings: FusionSettings
) -> tuple[list[tuple[NDArray[np.int64], Box3D]], int]:
    """DBSCAN, a box in the direction of gravity around each cluster, merging, and the volume filter.

    Returns the rows of each cluster's points with its box, and how many boxes the volume filter dropped.
    xyz: (n, 3) float32 metres, without planes; up: (3,) unit. A box spans the least to the largest coordinate along the
    axes of Eq. 16. Clusters whose boxes intersect are merged, boxes below `volume_min` dropped. There is no other rule.
    """
    labels = density_labels(xyz, settings)
    clusters = [np.flatnonzero(labels == label) for label in range(labels.max(initial=-1) + 1)]
    R_upright_world = rotation_to_z(up)
    upright = xyz @ R_upright_world.T
    low = [upright[rows].min(axis=0) for rows in clusters]
    high = [upright[rows].max(axis=0) for rows in clusters]
    found, groups = [], intersecting(np.array(low).reshape(-1, 3), np.array(high).reshape(-1, 3))
    for group in groups:
        least, largest = (np.min([low[k] for k in group], axis=0), np.max([high[k] for k in group], axis=0))
        box = Box3D(R_upright_world.T @ (least + largest) / 2, largest - least, R_upright_world.T)
        if box.volume >= settings.volume_min:
            found.append((np.concatenate([clusters[k] for k in group]), box))
    return found, len(groups) - len(found)


def density_labels(xyz: NDArray[np.float32], settings: FusionSettings) -> NDArray[np.int64]:
    """DBSCAN's cluster of each of (n, 3) points, (n,) int64, -1 = noise.

    Departs from the paper: the points of a cell of `density_cell` become one at their mean, weighted by their number,
    as DBSCAN's time and memory grow with all pairs of neighbours, hundreds for each point here. A point moves by less
    than the cell's diagonal, 9 mm, most by 2 mm, against a radius of 20 mm. The paper gives neither radius nor least
    neighbours. The radius is eps_min, so that what is apart by less than the least object is one. A surface of a frame
    has 430 points within it at VGA and 1 m, 110 at half size, that of a map about as many, and what noise leaves of a
    table up to a tenth of that. With 20, 50, 100 points: 25, 14, 9 boxes hold 75, 66, 31 % of redkitchen's labelled
    points, and single frames detect 0.07, 0.21, 0.35 of HOTS' objects, 0.66, 0.66, 0.62 of OSD's.
    """
    if len(xyz) == 0:
        return np.zeros(0, np.int64)
    from sklearn.cluster import DBSCAN  # slow to import, and used by the paper's way alone

    clustering = DBSCAN(eps=settings.density_radius, min_samples=settings.density_points)
    if settings.density_cell == 0:
        return np.asarray(clustering.fit_predict(xyz), np.int64)
    cell_of, count = _cells(xyz, settings.density_cell)
    sums = np.stack([np.bincount(cell_of, column, len(count)) for column in xyz.T], axis=1)
    labels = clustering.fit_predict(sums / count[:, None], sample_weight=count)
    return np.asarray(labels, np.int64)[cell_of]


def _cells(xyz: NDArray[np.float32], edge: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number of each point's cell, (n,), and how many points each cell has."""
    i, j, k = np.floor((xyz - xyz.min(axis=0)) / edge).astype(np.int64).T
    _, cell_of, count = np.unique((i << 42) | (j << 21) | k, return_inverse=True, return_counts=True)
    return cell_of.reshape(-1), count


def intersecting(low: NDArray[np.float64], high: NDArray[np.float64]) -> list[list[int]]:
    """Groups of boxes that intersect, merged until no two groups' common boxes do.

    low, high: (n, 3) ends of boxes along common axes.
    """
    low, high = low.copy(), high.copy()
    groups = [[k] for k in range(len(low))]
    k = 0
    while k < len(groups):
        meets = ((low < high[k]) & (low[k] < high)).all(axis=1)
        meets[k] = False
        others = np.flatnonzero(meets)
        if len(others) == 0:
            k += 1
            continue
        low[k], high[k] = np.minimum(low[k], low[others].min(axis=0)), np.maximum(high[k], high[others].max(axis=0))
        groups[k] += [member for other in others for member in groups[other]]
        kept = ~meets
        low, high, groups = low[kept], high[kept], [group for group, keep in zip(groups, kept, strict=True) if keep]
        k = 0  # the common box may meet one that was passed
    return groups


def _described(points: FrequentPoints, rows: NDArray[np.int64], box: Box3D) -> FoundObject:
    """The object of these points, not yet numbered."""
    members = points.take(rows)
    colour = members.colour.mean(axis=0, dtype=np.float64)
    confidence = float(members.heat.mean(dtype=np.float64))
    return FoundObject(0, box, confidence, int(members.frequency.max()), len(members), colour)
