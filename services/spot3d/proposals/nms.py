"""Non-maximum suppression of boxes by overlap, the threshold fixed or falling (EdgeBoxes, Sec. 3.4)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def suppress(
    windows: NDArray[np.int32], order: NDArray[np.int64], beta: np.float32, eta: np.float32, most: int
) -> NDArray[np.int64]:
    """Indices, best first, of at most `most` windows, none overlapping a better one by an IoU above beta.

    windows: (n, 4) int32 [x0, y0, x1, y1]; order: (n,) int64, best first. With eta < 1 beta is multiplied by
    it after each window kept, while it is above 0.5.
    """
    kept = np.empty(min(most, order.size), np.int64)
    areas = np.empty(kept.size, np.float32)
    n = 0
    for k in range(order.size):
        if n == kept.size:
            break
        i = order[k]
        x0, y0, x1, y1 = windows[i]
        area = np.float32(x1 - x0) * np.float32(y1 - y0)
        clear = True
        for j in range(n):
            # The IoU is at most the ratio of the areas.
            if areas[j] * beta > area or area * beta > areas[j]:
                continue
            other = windows[kept[j]]
            w, h = min(x1, other[2]) - max(x0, other[0]), min(y1, other[3]) - max(y0, other[1])
            if w > 0 and h > 0:
                shared = np.float32(w * h)
                if shared > beta * (area + areas[j] - shared):
                    clear = False
                    break
        if clear:
            kept[n], areas[n] = i, area
            n += 1
            if eta < 1 and beta > np.float32(0.5):
                beta *= eta
    return kept[:n]
