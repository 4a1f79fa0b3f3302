"""Upright boxes around clusters of points (paper, Sec. IV-D, Eq. 15)."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.kernel import kernel, part

_SAMPLE = 1000
"""About as many points of a cluster tell its rough box, and how much of it lies in another's."""
_ELONGATED = 1.2
"""A footprint whose principal spreads differ by this factor has a direction of its own."""
_ROUND = 0.89
"""Share of its smallest rectangle that a footprint fills: half-way between an ellipse (pi / 4) and a rectangle."""
_LENGTHWISE = 1.15
"""A mug's rectangle along its handle is up to a ninth larger than that across it, and noise adds to that."""
_MARGIN = 0.005
"""The two faces of a thin wall (a bowl's, a mug's) lie about this far apart, metres."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """Rows of the points that belong together, and the box around them."""

    rows: NDArray[np.int64]
    box: Box3D


def rotation_to_upright(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation R_upright_world that turns `up` (unit, world) into +z by the shortest way (paper, Eq. 15).

    The paper turns the normal into y; z is the robot world's up. (3, 3) float64.
    """
    x, y, c = up.tolist()
    if c < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    skew = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    rotation: NDArray[np.float64] = np.eye(3) + skew + skew @ skew / (1 + c)
    return rotation


def upright_box(
    points: NDArray[np.float32],
    up: NDArray[np.float64],
    turn: bool,
    trim: float = 0.0,
    lengthwise: bool = False,
) -> Box3D:
    """The tight box of (n, 3) world points whose third axis is `up`.

    turn: choose the yaw of the smallest footprint (else the axes of Eq. 15 are kept); lengthwise: that of a
    round thing's length instead. trim: share of the points left out at each end of each axis, so that a few stray
    points do not stretch the box.
    """
    R = rotation_to_upright(up)
    upright = _turned(points, R)
    if turn:
        yaw = _footprint_yaw(upright[:2], lengthwise)
        c, s = np.cos(yaw), np.sin(yaw)
        R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ R
        upright = _turned(points, R)
    low, high = trimmed(upright, trim)
    return Box3D(R.T @ ((low + high) / 2), high - low, R.T)


def _footprint_yaw(footprint: NDArray[np.float64], lengthwise: bool) -> float:
    """Direction of the sides of the smallest rectangle around (2, n) points (rotating calipers), radians.

    The area of a round thing's rectangle hardly depends on its direction, and where it has a handle it is smallest
    across: lengthwise, the sides follow the principal axes instead.
    """
    hull = cv2.convexHull(_outer(footprint))
    _, sides, degrees = cv2.minAreaRect(hull)
    if lengthwise:
        moments = cv2.moments(hull)
        xx, yy, xy = moments["mu20"], moments["mu02"], moments["mu11"]
        middle, radius = (xx + yy) / 2, float(np.hypot((xx - yy) / 2, xy))
        elongated = middle + radius > _ELONGATED**2 * (middle - radius)
        smallest = float(sides[0] * sides[1])
        yaw = float(np.arctan2(2 * xy, xx - yy) / 2)
        axes = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        along = float(np.prod(np.ptp(hull.reshape(-1, 2) @ axes.T, axis=0)))
        if elongated and moments["m00"] < _ROUND * smallest and along < _LENGTHWISE * smallest:
            return yaw
    return float(np.deg2rad(degrees))


@kernel("f4[:,::1](f8[:,::1])")
def _outer(footprint: NDArray[np.float64]) -> NDArray[np.float32]:
    """Those of (2, n) points that may be corners of their convex hull, from the first one: (m, 2) float32.

    Left out are those within the octagon of the points that are outermost along the axes and the diagonals. A hull
    is found by sorting, which takes far longer than this for many points.
    """
    n = footprint.shape[1]
    outermost = np.zeros(8, np.int64)  # counter-clockwise
    reached = np.full(8, -np.inf)
    for i in range(n):
        x, y = footprint[0, i], footprint[1, i]
        for k, along in enumerate((x, x + y, y, y - x)):
            if along > reached[k]:
                reached[k], outermost[k] = along, i
            if -along > reached[k + 4]:
                reached[k + 4], outermost[k + 4] = -along, i
    edges, count = np.empty((8, 3)), 0
    for k in range(8):
        a, b = outermost[k], outermost[(k + 1) % 8]
        across, along = footprint[0, b] - footprint[0, a], footprint[1, b] - footprint[1, a]
        if across != 0 or along != 0:
            edges[count] = -along, across, along * footprint[0, a] - across * footprint[1, a]
            count += 1
    outer, kept = np.empty((n, 2), np.float32), 0
    for i in range(n):
        inside = count > 0
        for k in range(count):
            inside &= edges[k, 0] * footprint[0, i] + edges[k, 1] * footprint[1, i] + edges[k, 2] > 0
        # Near the origin, where float32 is fine enough.
        outer[kept, 0], outer[kept, 1] = footprint[0, i] - footprint[0, 0], footprint[1, i] - footprint[1, 0]
        kept += not inside
    return outer[:kept]


def trimmed(values: NDArray[np.float64], trim: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The quantiles `trim` and 1 - `trim` of each row of (k, n) values, interpolated between two values: (k,) each.

    Raises ValueError without values.
    """
    last = values.shape[1] - 1
    if last < 0:
        raise ValueError("no values have no quantiles")
    outer, share = divmod(trim * last, 1)
    low, high = _ends(np.ascontiguousarray(values), int(outer), min(int(outer) + 1, last))
    return low[0] + share * (low[1] - low[0]), high[0] + share * (high[1] - high[0])


@part()
def _sink(heap: NDArray[np.float64], value: float) -> None:
    """Put a smaller value in place of the largest, the first of a heap."""
    place, child = 0, 1
    while child < len(heap):
        if child + 1 < len(heap) and heap[child + 1] > heap[child]:
            child += 1
        if heap[child] <= value:
            break
        heap[place] = heap[child]
        place, child = child, 2 * child + 1
    heap[place] = value


@kernel("Tuple((f8[:,::1], f8[:,::1]))(f8[:,::1], i8, i8)")
def _ends(values: NDArray[np.float64], outer: int, inner: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each row of (k, n) values the two at these places from below, in their order, and from above: (2, k) each.

    inner: the place after `outer`, or the same. For a few per cent at the ends it is faster than to sort all.
    """
    ends = np.empty((2, 2, len(values)))
    heap = np.empty(inner + 1)
    for row in range(len(values)):
        for end, sign in enumerate((1.0, -1.0)):
            heap[:] = np.inf  # the largest first: of those so far, what a smaller one drives out
            for value in values[row]:
                if sign * value < heap[0]:
                    _sink(heap, sign * value)
            ends[end, 1, row] = sign * heap[0]
            ends[end, 0, row] = sign * heap[1 : min(3, inner + 1)].max() if inner > outer else sign * heap[0]
    return ends[0], ends[1]


@kernel("f8[:,::1](f4[:,:], f8[:,:])")
def _turned(points: NDArray[np.float32], R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, n) float64: R times each of (n, 3) points."""
    turned = np.empty((3, len(points)))
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        for axis in range(3):
            turned[axis, i] = R[axis, 0] * x + R[axis, 1] * y + R[axis, 2] * z
    return turned


def with_bottom(box: Box3D, height: float) -> Box3D:
    """The same upright box with its bottom at `height` along its third axis (metres), its top unchanged."""
    up = box.rotation[:, 2]
    top = float(up @ box.centre) + box.size[2] / 2
    size = np.array([box.size[0], box.size[1], max(0.0, top - height)])
    return Box3D(box.centre + (top - size[2] / 2 - float(up @ box.centre)) * up, size, box.rotation)


def merge_intersecting(
    clusters: list[NDArray[np.int64]], points: NDArray[np.float32], up: NDArray[np.float64]
) -> list[NDArray[np.int64]]:
    """Join clusters whose boxes intersect, until none do (paper, Sec. IV-D). Clusters are rows of `points`."""
    clusters = list(clusters)
    while True:
        boxes = [upright_box(points[rows], up, turn=False) for rows in clusters]
        overlap = np.triu(iou_matrix_3d(boxes, boxes), 1)
        pairs = np.argwhere(overlap > 0)
        if len(pairs) == 0:
            return clusters
        a, b = pairs[0]
        clusters[a] = np.concatenate((clusters[a], clusters[b]))
        del clusters[b]


def merge_contained(
    clusters: list[Cluster],
    holds: list[bool],
    points: NDArray[np.float32],
    box_of: Callable[[NDArray[np.float32]], Box3D],
    share: float,
) -> list[NDArray[np.int64]]:
    """Join a cluster with the larger one in whose box at least `share` of its points lie, or the other way round.

    The inside of a bowl and its outside are one object, though no surface connects them, and so are the top of a
    book and its sides: two things never fill the same space. Objects that only touch stay apart. Clusters are of
    rows of `points`; the smallest joins first, into the box that holds most of it. Returns the rows of each.
    holds: whether each may take others in. box_of: the box of (n, 3) points.
    """
    order = sorted(range(len(clusters)), key=lambda k: len(clusters[k].rows))
    held, parts, boxes = [holds[k] for k in order], [clusters[k].rows for k in order], [clusters[k].box for k in order]
    samples = [sampled(points, rows) for rows in parts]
    centre = np.array([box.centre for box in boxes]).reshape(-1, 3)
    radius = np.array([np.linalg.norm(box.size) / 2 + _MARGIN for box in boxes])
    gone = np.zeros(len(parts), np.bool_)
    for i in range(len(parts)):
        near = np.linalg.norm(centre[i + 1 :] - centre[i], axis=1) < radius[i + 1 :] + radius[i]
        inside: dict[int, float] = {}
        for j in (np.flatnonzero(near) + i + 1).tolist():
            into = share_inside(samples[i], boxes[j], _MARGIN) if held[j] else 0.0
            around = share_inside(samples[j], boxes[i], _MARGIN) if held[j] and held[i] else 0.0
            inside[j] = max(into, around)
        j = max(inside, key=inside.__getitem__, default=i)
        if inside.get(j, 0.0) >= share:
            gone[i] = True
            parts[j] = np.concatenate((parts[j], parts[i]))
            samples[j] = sampled(points, parts[j])
            boxes[j] = box_of(samples[j])
            centre[j], radius[j] = boxes[j].centre, np.linalg.norm(boxes[j].size) / 2 + _MARGIN
    return [rows for rows, joined in zip(parts, gone, strict=True) if not joined]


def sampled(points: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """Of these rows of (n, 3) points as many, evenly spread, as tell a rough box."""
    return points.take(rows[:: max(1, len(rows) // _SAMPLE)], axis=0)


def share_inside(points: NDArray[np.float32], box: Box3D, margin: float = 0.0) -> float:
    """Share of (n, 3) world points that lie in the box, or within `margin` metres of it."""
    return _share_inside(points, box.centre, box.rotation, box.size / 2 + margin)


@kernel("f8(f4[:,:], f8[:], f8[:,:], f8[:])")
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
