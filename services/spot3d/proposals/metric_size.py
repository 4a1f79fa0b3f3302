"""Which windows the hard filter will surely reject for their metric size, known before they are scored."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part

CELL = 16  # side of the finest cell, pixels


class DepthRange(NamedTuple):
    """Nearest and farthest depth of square cells, and the limits on a window's size.

    nearest, farthest: (levels, rows, columns) float32 metres; level k has cells of CELL * 2^k pixels; a
    cell without depth has nearest inf and farthest 0. limits: (4,) float32, fx, fy, epsilon_min,
    epsilon_max; fx = 0 lets every window pass.
    """

    nearest: NDArray[np.float32]
    farthest: NDArray[np.float32]
    limits: NDArray[np.float32]


def depth_range(depth: NDArray[np.float32], fx: float, fy: float, min_size: float, max_size: float) -> DepthRange:
    """Depth ranges of an image (h, w) float32 metres, 0 = invalid; sizes in metres, fx and fy in pixels."""
    h, w = depth.shape
    levels = 1
    while (CELL << levels) < max(h, w):
        levels += 1
    shape = (levels, (h + CELL - 1) // CELL, (w + CELL - 1) // CELL)
    nearest, farthest = np.full(shape, np.inf, np.float32), np.zeros(shape, np.float32)
    _depth_range(np.ascontiguousarray(depth), nearest, farthest)
    return DepthRange(nearest, farthest, np.array([fx, fy, min_size, max_size], np.float32))


@kernel()
def _depth_range(depth: NDArray[np.float32], nearest: NDArray[np.float32], farthest: NDArray[np.float32]) -> None:
    """Fill the levels of DepthRange, which are inf and 0: the finest from the image, each other from the one before."""
    h, w = depth.shape
    for y in range(h):
        for x in range(w):
            z = depth[y, x]
            if z > 0:
                r, c = y // CELL, x // CELL
                nearest[0, r, c] = z if z < nearest[0, r, c] else nearest[0, r, c]
                farthest[0, r, c] = z if z > farthest[0, r, c] else farthest[0, r, c]
    levels, rows, columns = nearest.shape
    for k in range(1, levels):
        for r in range(rows):
            for c in range(columns):
                near, far = nearest[k - 1, r, c], farthest[k - 1, r, c]
                if near < nearest[k, r >> 1, c >> 1]:
                    nearest[k, r >> 1, c >> 1] = near
                if far > farthest[k, r >> 1, c >> 1]:
                    farthest[k, r >> 1, c >> 1] = far


@part()
def surely_rejected(ranges: DepthRange, x0: int, y0: int, x1: int, y1: int) -> bool:
    """Whether Eq. 5 (paper, Sec. IV-C) rejects the window x0..x1 - 1, y0..y1 - 1 whatever its mean depth is.

    The mean lies between the nearest and farthest depth of the cells that cover the window, so a window that
    is too small at the farthest, too big at the nearest, or without any depth, can be skipped.
    """
    nearest, farthest, limits = ranges
    fx, fy, min_size, max_size = limits[0], limits[1], limits[2], limits[3]
    if fx == 0:
        return False
    side = x1 - x0 if x1 - x0 > y1 - y0 else y1 - y0
    level, cell, last = 0, CELL, nearest.shape[0] - 1
    while cell < side and level < last:
        level, cell = level + 1, cell * 2
    near, far = np.float32(np.inf), np.float32(0)
    for r in range(y0 // cell, (y1 - 1) // cell + 1):
        for c in range(x0 // cell, (x1 - 1) // cell + 1):
            low, high = nearest[level, r, c], farthest[level, r, c]
            near = low if low < near else near
            far = high if high > far else far
    if far == 0:
        return True
    w, h = (x1 - x0) / fx, (y1 - y0) / fy
    too_small = w * far < min_size and h * far < min_size
    return bool(too_small or (w * near > max_size and h * near > max_size))
