"""The score of one window: contours wholly inside it, by its size (EdgeBoxes, Sec. 3.2 and 3.3)."""

import numpy as np

from spot3d.kernel import part
from spot3d.proposals.affinity import MIN_AFFINITY
from spot3d.proposals.window_index import WindowIndex

Pixel = int | np.int64  # one type when compiled: other integers would compile everything once more


@part()
def score_limit(index: WindowIndex, x0: Pixel, y0: Pixel, x1: Pixel, y1: Pixel) -> np.float32:
    """The highest score of the window x0..x1 - 1, y0..y1 - 1: as if no contour crossed its border."""
    sums = index.sums
    w, h = x1 - x0, y1 - y0
    inside = sums[y1, x1, 0] - sums[y0, x1, 0] - sums[y1, x0, 0] + sums[y0, x0, 0]
    x2, y2 = x0 + w // 4, y0 + h // 4
    x3, y3 = x2 + w // 2, y2 + h // 2
    centre = sums[y3, x3, 1] - sums[y2, x3, 1] - sums[y3, x2, 1] + sums[y2, x2, 1]
    limit: np.float32 = (inside - centre) * index.norm[w + h]
    return limit


@part()
def anchored(index: WindowIndex, g: int, x0: Pixel, y0: Pixel, x1: Pixel, y1: Pixel) -> bool:
    """Whether group g has its anchor in the window; without branches, which would be mispredicted."""
    x, y = index.anchor[g, 0], index.anchor[g, 1]
    inside: bool = (x0 <= x) & (x < x1) & (y0 <= y) & (y < y1)
    return inside


@part()
def meet(index: WindowIndex, line: int, begin: int, end: int, now: int, tail: int) -> int:
    """Queue the groups of `lines[line, begin:end]` that window `now` meets first here; returns the queue's end."""
    for i in range(begin, end):
        g = index.lines[line, i]
        index.queue[tail] = g  # overwritten by the next one if it is not new
        tail += index.met[g] != now
        index.met[g] = now
    return tail


@part()
def score_window(index: WindowIndex, x0: Pixel, y0: Pixel, x1: Pixel, y1: Pixel, least: np.float32) -> np.float32:
    """Score of the window x0..x1 - 1, y0..y1 - 1, or 0 as soon as it is known to be no more than `least`.

    Groups with their anchor inside count with their magnitude times 1 - the best product of affinities along
    any path of groups from the window's border; edges in the centre of half the size are taken off; the rest
    is divided by the mean side to the power kappa (EdgeBoxes, Eq. 2 to 4).
    """
    score: np.float32 = score_limit(index, x0, y0, x1, y1)
    if score <= least:
        return np.float32(0)
    scale = index.norm[x1 - x0 + y1 - y0]
    starts, met, queue, waits, removed = index.starts, index.met, index.queue, index.waits, index.removed
    size = removed.size
    now = met[size] + 1
    met[size] = now
    tail = meet(index, 0, starts[y0, x0, 0], starts[y0, x1, 0], now, 0)
    tail = meet(index, 0, starts[y1 - 1, x0, 0], starts[y1 - 1, x1, 0], now, tail)
    tail = meet(index, 1, starts[y0, x0, 1], starts[y1, x0, 1], now, tail)
    tail = meet(index, 1, starts[y0, x1 - 1, 1], starts[y1, x1 - 1, 1], now, tail)
    crossing = np.float32(0)
    for i in range(tail):
        g = queue[i]
        removed[g], waits[g] = 1, 1
        crossing += index.magnitude[g] * np.float32(anchored(index, g, x0, y0, x1, y1))
    score -= crossing * scale
    if score <= least:
        return np.float32(0)
    head = 0
    while head != tail:
        g = queue[head]
        head = head + 1 if head < size else 0
        waits[g] = 0
        reached = removed[g]
        for k in range(index.first[g], index.first[g + 1]):
            weight = reached * index.affinity[k]
            if weight < np.float32(MIN_AFFINITY):
                break
            q = index.neighbour[k]
            if met[q] != now:
                met[q], removed[q], waits[q] = now, 0, 0
            gain = weight - removed[q]
            if gain > 0 and anchored(index, q, x0, y0, x1, y1):
                score -= gain * index.magnitude[q] * scale
                if score <= least:
                    return np.float32(0)
                removed[q] = weight
                queue[tail] = q
                if waits[q] == 0:
                    waits[q] = 1
                    tail = tail + 1 if tail < size else 0
    return score
