"""Non-maximum suppression of boxes by overlap (EdgeBoxes, Sec. 3.4)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel


def suppress(windows: NDArray[np.int32], order: NDArray[np.int64], beta: float, most: int) -> NDArray[np.int64]:
    """Indices, best first, of at most `most` windows, none overlapping a better one by an IoU above beta.

    windows: (n, 4) int32 [x0, y0, x1, y1]; order: (n,) int64, best first.
    """
    kept = np.empty(min(most, order.size), np.int64)
    sides = _Sides(*np.empty((5, kept.size), np.float32))
    return kept[: _suppress(windows, order, np.float32(beta), kept, sides)]


class _Sides(NamedTuple):
    """Sides and areas of the boxes kept, (k,) each."""

    left: NDArray[np.float32]
    top: NDArray[np.float32]
    right: NDArray[np.float32]
    bottom: NDArray[np.float32]
    areas: NDArray[np.float32]


@kernel()
def _suppress(
    windows: NDArray[np.int32], order: NDArray[np.int64], beta: np.float32, kept: NDArray[np.int64], sides: _Sides
) -> int:
    """Write the indices of the windows kept; returns their number. sides: buffers for theirs."""
    left, top, right, bottom, areas = sides
    zero = np.float32(0)
    n = 0
    for k in range(order.size):
        if n == kept.size:
            break
        x0, y0 = np.float32(windows[order[k], 0]), np.float32(windows[order[k], 1])
        x1, y1 = np.float32(windows[order[k], 2]), np.float32(windows[order[k], 3])
        area = (x1 - x0) * (y1 - y0)
        overlaps = False
        for j in range(n):  # to the end and free of branches, so that it runs several boxes at once
            w = (x1 if x1 < right[j] else right[j]) - (x0 if x0 > left[j] else left[j])
            h = (y1 if y1 < bottom[j] else bottom[j]) - (y0 if y0 > top[j] else top[j])
            shared = (w if w > zero else zero) * (h if h > zero else zero)
            overlaps |= shared > beta * (area + areas[j] - shared)
        if not overlaps:
            kept[n] = order[k]
            left[n], top[n], right[n], bottom[n], areas[n] = x0, y0, x1, y1, area
            n += 1
    return n
