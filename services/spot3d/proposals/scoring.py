"""The score of one window: contours wholly inside it, by its size (EdgeBoxes, Sec. 3.2 and 3.3)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

MIN_AFFINITY = 0.05  # paths of a lower affinity do not connect


@njit(cache=True, nogil=True)
def score_limit(sums: NDArray[np.float32], norm: NDArray[np.float32], x0: int, y0: int, x1: int, y1: int) -> np.float32:
    """Most that the window x0..x1 - 1, y0..y1 - 1 can score: as if no contour crossed its border."""
    w, h = x1 - x0, y1 - y0
    inside = sums[y1, x1, 0] - sums[y0, x1, 0] - sums[y1, x0, 0] + sums[y0, x0, 0]
    x2, y2 = x0 + w // 4, y0 + h // 4
    x3, y3 = x2 + w // 2, y2 + h // 2
    centre = sums[y3, x3, 1] - sums[y2, x3, 1] - sums[y3, x2, 1] + sums[y2, x2, 1]
    limit: np.float32 = (inside - centre) * norm[w + h]
    return limit


@njit(cache=True, nogil=True)
def score_window(
    sums: NDArray[np.float32],
    norm: NDArray[np.float32],
    starts: NDArray[np.int32],
    lines: NDArray[np.int32],
    groups: NDArray[np.int32],
    magnitude: NDArray[np.float32],
    neighbour: NDArray[np.int32],
    affinity: NDArray[np.float32],
    met: NDArray[np.int32],
    removed: NDArray[np.float32],
    x0: int,
    y0: int,
    x1: int,
    y1: int,
    least: np.float32,
) -> np.float32:
    """Score of the window x0..x1 - 1, y0..y1 - 1, or 0 as soon as it is known to be no more than `least`.

    Groups with their anchor inside count with their magnitude times 1 - the best product of affinities along
    any path of groups from the window's border; edges in the centre of half the size are taken off; the rest
    is divided by the mean side to the power kappa (EdgeBoxes, Eq. 2 to 4). The arrays are WindowIndex's.
    """
    score = score_limit(sums, norm, x0, y0, x1, y1)
    if score <= least:
        return np.float32(0)
    scale = norm[x1 - x0 + y1 - y0]
    size = removed.size
    met[size, 0] += 1
    now = met[size, 0]
    tail = 0
    for side in range(4):
        if side < 2:
            y = y0 if side == 0 else y1 - 1
            line, begin, end = 0, starts[y, x0, 0], starts[y, x1, 0]
        else:
            x = x0 if side == 2 else x1 - 1
            line, begin, end = 1, starts[y0, x, 1], starts[y1, x, 1]
        for i in range(begin, end):
            g = lines[line, i]
            if met[g, 0] != now:
                met[g, 0], met[g, 1], met[tail, 2] = now, 1, g
                removed[g] = 1
                tail += 1
                if x0 <= groups[g, 0] < x1 and y0 <= groups[g, 1] < y1:
                    score -= magnitude[g] * scale
    if score <= least:
        return np.float32(0)
    head = 0
    while head != tail:
        g = met[head, 2]
        head = head + 1 if head < size else 0
        met[g, 1] = 0
        weight_here = removed[g]
        for k in range(groups[g, 2], groups[g, 3]):
            weight = weight_here * affinity[k]
            if weight < np.float32(MIN_AFFINITY):
                break
            q = neighbour[k]
            if met[q, 0] != now:
                if not (x0 <= groups[q, 0] < x1 and y0 <= groups[q, 1] < y1):
                    continue
                met[q, 0], met[q, 1] = now, 0
                removed[q] = 0
            gain = weight - removed[q]
            if gain > 0:
                score -= gain * magnitude[q] * scale
                if score <= least:
                    return np.float32(0)
                removed[q] = weight
                if met[q, 1] == 0:
                    met[q, 1], met[tail, 2] = 1, q
                    tail = tail + 1 if tail < size else 0
    return score
