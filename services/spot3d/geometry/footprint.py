"""Kernels of `boxes`: the direction of the sides of a footprint's smallest rectangle."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part

_ELONGATED = 1.2
"""A footprint whose principal spreads differ by this factor has a direction of its own."""
_ROUND = 0.89
"""Share of its smallest rectangle that a footprint fills: half-way between an ellipse (pi / 4) and a rectangle."""
_LENGTHWISE = 1.15
"""A mug's rectangle along its handle is up to a ninth larger than that across it, and noise adds to that."""
_OCTAGON_OF = 256
"""About so many points tell well enough what is within."""


@kernel("f8[:,::1](f8[:,:])")
def outer_points(footprint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of (2, n) points that may be corners of their convex hull, from the first one: (m, 2).

    Left out are those within the octagon of the points that are outermost, of some of all, along the axes and the
    diagonals: a hull takes far longer than this for many points.
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


@kernel("UniTuple(f8, 2)(f8[:,::1])")
def smallest_rectangle(hull: NDArray[np.float64]) -> tuple[float, float]:
    """Direction of the sides of the smallest rectangle around a hull, 0 to pi / 2, and its area.

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
    return yaw % (np.pi / 2), smallest


@kernel("UniTuple(f8, 4)(f8[:,::1])")
def central_moments(hull: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Area and second central moments (xx, yy, xy) of what a hull encloses; all 0 where that is nothing."""
    area, x_total, y_total, xx, yy, xy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(hull)):
        following = k + 1 if k + 1 < len(hull) else 0
        a, b = hull[k, 0] - hull[0, 0], hull[k, 1] - hull[0, 1]
        c, d = hull[following, 0] - hull[0, 0], hull[following, 1] - hull[0, 1]
        twice = a * d - b * c
        area += twice / 2
        x_total += twice * (a + c) / 6
        y_total += twice * (b + d) / 6
        xx += twice * (a * a + a * c + c * c) / 12
        yy += twice * (b * b + b * d + d * d) / 12
        xy += twice * (2 * a * b + a * d + b * c + 2 * c * d) / 24
    if area <= 0:
        return 0.0, 0.0, 0.0, 0.0
    return area, xx - x_total**2 / area, yy - y_total**2 / area, xy - x_total * y_total / area


@kernel("f8(f8[:,:], b1)")
def footprint_yaw(footprint: NDArray[np.float64], lengthwise: bool) -> float:
    """Direction of the sides of the smallest rectangle around (2, n) points, radians.

    The area of a round thing's rectangle hardly depends on its direction, and where it has a handle it is smallest
    across: lengthwise, the sides follow the principal axes instead.
    """
    hull = convex_hull(outer_points(footprint))
    yaw, smallest = smallest_rectangle(hull)
    if lengthwise:
        area, xx, yy, xy = central_moments(hull)
        middle, radius = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy * xy)
        elongated = middle + radius > _ELONGATED**2 * (middle - radius)
        principal = np.arctan2(2 * xy, xx - yy) / 2
        along = _extents(hull, np.cos(principal), np.sin(principal))
        if elongated and area < _ROUND * smallest and along < _LENGTHWISE * smallest:
            return float(principal)
    return yaw
