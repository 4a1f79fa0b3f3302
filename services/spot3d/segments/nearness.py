"""Distances between the points of two pixels, for kernels. All lengths are shares of the range (see `creases`)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import part


@part()
def apart(points: NDArray[np.float32], v: int, u: int, y: int, x: int) -> tuple[np.float32, np.float32]:
    """Squared distance between the points of pixels (v, u) and (y, x), and the square of their mean depth."""
    a, b, c = points[y, x, 0] - points[v, u, 0], points[y, x, 1] - points[v, u, 1], points[y, x, 2] - points[v, u, 2]
    depth = np.float32(0.5) * (points[v, u, 2] + points[y, x, 2])
    return a * a + b * b + c * c, depth * depth


@part()
def within(points: NDArray[np.float32], v: int, u: int, y: int, x: int, share: np.float32) -> bool:
    """Whether the points of pixels (v, u) and (y, x) are nearer to each other than this share of their range."""
    square, range_square = apart(points, v, u, y, x)
    return bool(square < share * share * range_square)
