"""Kernels of `upright`: the direction of the sides of a footprint's smallest rectangle.

`cv2.minAreaRect` finds the same to 3e-7 rad, but takes three times as long for 200 and 1000 points and eight times for
10,000. `scipy.spatial.ConvexHull` alone takes 18 times as long and more.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part

_OCTAGON_OF = 256
"""The octagon is found among about this many points."""


@kernel("f8[:,::1](f8[:,:])")
def outer_points(footprint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of (2, n) points that may be corners of their convex hull, relative to the first one: (m, 2).

    Points within an octagon are left out. Its corners are the outermost points, of a sample, along the axes and the
    diagonals. The hull of many points takes far longer than this.
    """
    n = footprint.shape[1]
    outermost = np.zeros(8, np.int64)  # counter-clockwise
    reached = np.full(8, -np.inf)
    for i in range(0, n, max(1, n // _OCTAGON_OF)):
        x, y = footprint[0, i], footprint[1, i]
        for k, along in enumerate((x, x + y, y, y - x)):
            if along > reached[k]:
                reached[k], outermost[k] = along, i
            if -along > reached[k + 4]:
                reached[k + 4], outermost[k + 4] = -along, i
    depth, straight = np.full(n, np.inf), True
    for k in range(8):
        a, b = outermost[k], outermost[(k + 1) % 8]
        across, along = footprint[0, b] - footprint[0, a], footprint[1, b] - footprint[1, a]
        if across != 0 or along != 0:
            straight = False
            offset = along * footprint[0, a] - across * footprint[1, a]
            for i in range(n):  # one edge after the other, so that several points are computed at once
                depth[i] = min(depth[i], across * footprint[1, i] - along * footprint[0, i] + offset)
    outer, kept = np.empty((n, 2)), 0
    for i in range(n):
        # Near the origin, where cancellation costs least.
        outer[kept, 0], outer[kept, 1] = footprint[0, i] - footprint[0, 0], footprint[1, i] - footprint[1, 0]
        kept += straight or not depth[i] > 0
    return outer[:kept]


@kernel("f8[:,::1](f8[:,::1])")
def convex_hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The corners of the convex hull of (n, 2) points, counter-clockwise: (h, 2) (gift wrapping; Jarvis, 1973)."""
    hull, count, start = np.empty_like(points), 0, 0
    for i in range(len(points)):
        if points[i, 0] < points[start, 0] or (points[i, 0] == points[start, 0] and points[i, 1] < points[start, 1]):
            start = i
    corner = start
    while count < len(points):
        x, y = points[corner, 0], points[corner, 1]
        hull[count, 0], hull[count, 1] = x, y
        count += 1
        u, v = 0.0, 0.0  # the way to the next corner: nothing is to its right
        for i in range(len(points)):
            p, q = points[i, 0] - x, points[i, 1] - y
            turn = u * q - v * p
            if turn < 0 or (turn == 0 and p * p + q * q > u * u + v * v):
                u, v, corner = p, q, i
        if (u == 0 and v == 0) or (points[corner, 0] == points[start, 0] and points[corner, 1] == points[start, 1]):
            break
    return hull[:count]


@part()
def _extents(hull: NDArray[np.float64], cosine: float, sine: float) -> float:
    """The area of the rectangle around a hull whose sides have this direction."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for k in range(len(hull)):
        x, y = cosine * hull[k, 0] + sine * hull[k, 1], cosine * hull[k, 1] - sine * hull[k, 0]
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    return float((high_x - low_x) * (high_y - low_y))


@kernel("f8(f8[:,::1])")
def smallest_rectangle(hull: NDArray[np.float64]) -> float:
    """Direction of the sides of the smallest rectangle around a hull, 0 to pi / 2.

    One of its sides lies on one of the hull's (Freeman and Shapira, 1975).
    """
    yaw, smallest = 0.0, np.inf
    for k in range(len(hull)):
        following = k + 1 if k + 1 < len(hull) else 0
        x, y = hull[following, 0] - hull[k, 0], hull[following, 1] - hull[k, 1]
        length = np.sqrt(x * x + y * y)
        if length > 0:
            area = _extents(hull, x / length, y / length)
            if area < smallest:
                yaw, smallest = np.arctan2(y, x), area
    return float(yaw % (np.pi / 2))


@kernel("f8(f8[:,:])")
def footprint_yaw(footprint: NDArray[np.float64]) -> float:
    """Direction of the sides of the smallest rectangle around (2, n) points, radians."""
    return smallest_rectangle(convex_hull(outer_points(footprint)))
