"""Which windows cannot be objects for their metric size: the hard filter, asked before anything is scored."""

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


@kernel()
def depth_range(
    depth: NDArray[np.float32], fx: np.float32, fy: np.float32, min_size: np.float32, max_size: np.float32
) -> DepthRange:
    """Depth ranges of an image (h, w) float32 metres, 0 = invalid; sizes in metres, fx and fy in pixels."""
    h, w = depth.shape
    rows, columns = (h + CELL - 1) // CELL, (w + CELL - 1) // CELL
    levels = 1
    while (CELL << levels) < max(h, w):
        levels += 1
    nearest = np.full((levels, rows, columns), np.inf, np.float32)
    farthest = np.zeros((levels, rows, columns), np.float32)
    for y in range(h):
        for x in range(w):
            z = depth[y, x]
            if z > 0:
                r, c = y // CELL, x // CELL
                nearest[0, r, c] = min(nearest[0, r, c], z)
                farthest[0, r, c] = max(farthest[0, r, c], z)
    for k in range(1, levels):
        for r in range(rows):
            for c in range(columns):
                nearest[k, r >> 1, c >> 1] = min(nearest[k, r >> 1, c >> 1], nearest[k - 1, r, c])
                farthest[k, r >> 1, c >> 1] = max(farthest[k, r >> 1, c >> 1], farthest[k - 1, r, c])
    return DepthRange(nearest, farthest, np.array([fx, fy, min_size, max_size], np.float32))


@part()
def surely_rejected(ranges: DepthRange, x0: int, y0: int, x1: int, y1: int) -> bool:
    """Whether Eq. 4 (paper, Sec. III-C) rejects the window x0..x1 - 1, y0..y1 - 1 whatever its mean depth is.

    The mean lies between the nearest and farthest depth of the cells that cover the window, so a window that
    is too small at the farthest, too big at the nearest, or without any depth, can be left out unseen.
    """
    fx, fy, min_size, max_size = ranges.limits
    if fx == 0:
        return False
    level, cell = 0, CELL
    while cell < max(x1 - x0, y1 - y0):
        level, cell = level + 1, cell * 2
    level = min(level, ranges.nearest.shape[0] - 1)
    cell = CELL << level
    near, far = np.float32(np.inf), np.float32(0)
    for r in range(y0 // cell, (y1 - 1) // cell + 1):
        for c in range(x0 // cell, (x1 - 1) // cell + 1):
            near = min(near, ranges.nearest[level, r, c])
            far = max(far, ranges.farthest[level, r, c])
    if far == 0:
        return True
    w, h = (x1 - x0) / fx, (y1 - y0) / fy
    too_small = w * far < min_size and h * far < min_size
    return bool(too_small or (w * near > max_size and h * near > max_size))
