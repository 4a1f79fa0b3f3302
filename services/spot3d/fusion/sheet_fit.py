"""Kernels of `sheet`: fitting a plane with a warp to the points near it."""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.order import quantiles, value_at
from spot3d.fusion.sheet_kernels import plane_distances
from spot3d.kernel import kernel

FITTED_MIN = 50
"""Fewer points tell no sheet."""
_FACING = 0.8
"""Cosine (37 degrees) within which a point that takes part in the fit faces as the plane."""
_RIM = 0.02
"""Share of the points beyond each end of a sheet's extent."""
_EXTENT_MIN = 0.05
"""A sheet is taken to reach at least so far each way, metres."""
_FITS = 6
"""Rounds of reweighting."""
_SPREAD_MIN = 1e-3
"""No sheet is flatter than this, metres."""


@kernel("f8[:,::1](f4[:,::1], f4[:,::1], f8[::1], f8)")
def facing_points(
    points: NDArray[np.float32], normals: NDArray[np.float32], plane: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """The points within `reach` of the plane that face its way, (3, m)."""
    chosen = np.empty((3, len(points)))
    count, distance = 0, plane_distances(points, plane)
    for i in range(len(points)):
        if abs(distance[i]) < reach:
            cosine = plane[0] * normals[i, 0] + plane[1] * normals[i, 1] + plane[2] * normals[i, 2]
            if cosine > _FACING:
                for axis in range(3):
                    chosen[axis, count] = points[i, axis]
                count += 1
    return chosen[:, :count].copy()


@kernel("f8[:,::1](f8[:])")
def in_plane_axes(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors across a unit normal and each other: (2, 3)."""
    x, y, z = normal[0], normal[1], normal[2]
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        a, b, c = 0.0, z, -y
    elif abs(y) <= abs(z):
        a, b, c = -z, 0.0, x
    else:
        a, b, c = y, -x, 0.0
    length = np.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])


@kernel("f8(f8[::1], f8[::1])", fastmath={"reassoc", "contract"})
def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The sum of the products of two (n,), in whatever order is fastest."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@kernel("f8[::1](f8[:,:], f8[:])")
def solved(square: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """The solution of a small system (k, k), (k,) that is symmetric and positive definite: both are used up."""
    k = len(right)
    for a in range(k):
        for b in range(a + 1, k):
            share = square[b, a] / square[a, a]
            right[b] -= share * right[a]
            for c in range(a, k):
                square[b, c] -= share * square[a, c]
    solution = np.empty(k)
    for a in range(k - 1, -1, -1):
        rest = right[a]
        for b in range(a + 1, k):
            rest -= square[a, b] * solution[b]
        solution[a] = rest / square[a, a]
    return solution


@kernel("Tuple((f8[::1], f8))(f8[:,::1], f8[::1], f8)")
def reweighted(
    terms: NDArray[np.float64], distance: NDArray[np.float64], scale: float
) -> tuple[NDArray[np.float64], float]:
    """Coefficients of the terms (k, n) that give the distances (n,), and the spread of the rest. scale: a first one.

    Iteratively reweighted least squares with Tukey's weights.
    """
    k, n = terms.shape
    warp, off, weight, weighted = np.zeros(k), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        off[i] = abs(distance[i])
    square, right = np.empty((k, k)), np.empty(k)
    for _ in range(_FITS):
        per_reach = 1 / (3 * scale)
        for i in range(n):
            share = off[i] * per_reach
            weight[i] = (1 - share * share) ** 2 if share < 1 else 0.0
        for a in range(k):
            for i in range(n):
                weighted[i] = weight[i] * terms[a, i]
            right[a] = _dot(weighted, distance)
            for b in range(a + 1):
                square[a, b] = square[b, a] = _dot(weighted, terms[b])
            square[a, a] += 1e-3 * n  # keeps the warp flat where a thin strip says nothing about it
        warp = solved(square, right)
        for i in range(n):
            off[i] = distance[i]
        for a in range(k):
            for i in range(n):
                off[i] -= warp[a] * terms[a, i]
        count = 0
        for i in range(n):
            off[i] = abs(off[i])
            weighted[count] = off[i]
            count += off[i] < 3 * scale
        scale = max(_SPREAD_MIN, 1.4826 * value_at(weighted[:count], (count - 1) / 2))
    return warp, scale


@kernel("f8[:,::1](f8[:,:], f8[:,:], f8[:], i8)")
def warp_terms(
    points: NDArray[np.float64], axes: NDArray[np.float64], middle: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """So many of the terms 1, x, y, x^2, xy, y^2 of a warp (see `Sheet`) at (3, n) points: (count, n)."""
    terms = np.empty((count, points.shape[1]))
    for i in range(points.shape[1]):
        x, y = 0.0, 0.0
        for axis in range(3):
            x += axes[0, axis] * (points[axis, i] - middle[axis])
            y += axes[1, axis] * (points[axis, i] - middle[axis])
        x, y = min(max(x, -1.0), 1.0), min(max(y, -1.0), 1.0)
        terms[0, i], terms[1, i], terms[2, i] = 1.0, x, y
        if count > 3:
            terms[3, i], terms[4, i], terms[5, i] = x * x, x * y, y * y
    return terms


@kernel("Tuple((f8[:,::1], f8[::1], f8[::1], f8))(f8[:,::1], f8[:], f8, b1)")
def fitted_warp(
    points: NDArray[np.float64], plane: NDArray[np.float64], reach: float, warped: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Axes, middle, warp and spread of the sheet (see `Sheet`) through (3, n) points within `reach` of a plane."""
    n = points.shape[1]
    ends, axes = quantiles(points, _RIM), in_plane_axes(plane[:3])
    middle, across, distance = np.empty(3), np.zeros((2, n)), np.zeros(n)
    for axis in range(3):
        middle[axis] = (ends[0, axis] + ends[1, axis]) / 2
        for i in range(n):
            along = points[axis, i] - middle[axis]
            across[0, i] += axes[0, axis] * along
            across[1, i] += axes[1, axis] * along
            distance[i] += plane[axis] * points[axis, i]
    for side in range(2):
        for i in range(n):
            across[side, i] = abs(across[side, i])
    extents = quantiles(across, _RIM)
    for side in range(2):
        for axis in range(3):
            axes[side, axis] /= max(extents[1, side], _EXTENT_MIN)
    for i in range(n):
        distance[i] += plane[3]
    terms = warp_terms(points, axes, middle, 6 if warped else 3)
    fitted, spread = reweighted(terms, distance, reach / 2)
    warp = np.zeros(6)
    for k in range(len(fitted)):
        warp[k] = fitted[k]
    return axes, middle, warp, spread
