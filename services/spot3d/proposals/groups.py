"""Edge groups: short smooth pieces of contour (EdgeBoxes, Sec. 3.1)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.proposals.affinity import affinities

PI = np.float32(np.pi)
GROUP_TURN = np.float32(0.5)  # EdgeBoxes' own: a group ends when its orientation differences sum to this, units of pi
FREE, NONE = -2, -1  # labels of edge pixels without a group yet, and of pixels without any


class EdgePixels(NamedTuple):
    """An edge map with its pixels in reading order, and the indices of those that are edges.

    magnitude, orientation: (h * w,) float32; edges: (e,) int64, the pixels above 0, the image's border excepted;
    width: w.
    """

    magnitude: NDArray[np.float32]
    orientation: NDArray[np.float32]
    edges: NDArray[np.int64]
    width: int


class EdgeGroups(NamedTuple):
    """Groups 0..n-1 of edge pixels and their affinities as sparse rows, strongest first.

    label: (h, w) int32, group of each pixel, -1 = none; magnitude: (n,) float32, sum over the group's pixels;
    anchor: (n, 2) int32, x and y of the group's last pixel in reading order, which stands for its place;
    first: (n + 1,) int32, start of each group's row in `neighbour` (k,) int32 and `affinity` (k,) float32.
    """

    label: NDArray[np.int32]
    magnitude: NDArray[np.float32]
    anchor: NDArray[np.int32]
    first: NDArray[np.int32]
    neighbour: NDArray[np.int32]
    affinity: NDArray[np.float32]


def group_edges(
    magnitude: NDArray[np.float32],
    orientation: NDArray[np.float32],
    min_group_magnitude: float,
    gamma: float,
) -> EdgeGroups:
    """Groups of the edge map's pixels, and their affinities.

    magnitude, orientation: (h, w) float32, orientation of the normal in [0, pi). min_group_magnitude: groups whose
    magnitudes sum to no more than this are given to their neighbours.
    """
    edges = np.zeros(magnitude.shape, np.bool_)
    edges[1:-1, 1:-1] = magnitude[1:-1, 1:-1] > 0
    pixels = EdgePixels(magnitude.ravel(), orientation.ravel(), np.flatnonzero(edges), magnitude.shape[1])
    label, seen_by = np.full((2, magnitude.size), NONE, np.int32)
    label[pixels.edges] = FREE
    border, turns = np.empty_like(pixels.edges), np.empty(pixels.edges.size, np.float32)
    count = _cluster(pixels, label, seen_by, border, turns)
    total, number = np.zeros(count, np.float32), np.full(count, NONE, np.int32)
    count = _absorb_small(pixels, np.float32(min_group_magnitude), label, total, number, border)
    total, last = np.zeros(count, np.float32), np.zeros(count, np.int64)
    mean, normal = np.zeros((2, count, 2), np.float32)
    _describe(pixels, label, total, mean, normal, last)
    anchor = np.stack((last % pixels.width, last // pixels.width), axis=1).astype(np.int32)
    label = label.reshape(magnitude.shape)
    first, neighbour, affinity = affinities(label, pixels.edges, mean, normal, gamma)
    return EdgeGroups(label, total, anchor, first, neighbour, affinity)


@part()
def turn(a: np.float32, b: np.float32) -> np.float32:
    """Difference of two orientations in [0, pi), units of pi: 0 to 0.5."""
    d = abs(a - b) / PI
    return d if d <= np.float32(0.5) else np.float32(1) - d


@kernel()
def _cluster(
    pixels: EdgePixels,
    label: NDArray[np.int32],
    seen_by: NDArray[np.int32],
    border: NDArray[np.int64],
    turns: NDArray[np.float32],
) -> int:
    """Label the pixels that are FREE; returns the number of groups.

    Groups grow greedily: always by the bordering pixel of least turn, until the turns sum to GROUP_TURN. seen_by: NONE
    everywhere, then the last group that has the pixel on its border; border, turns: buffers for that border.
    """
    _, orientation, edges, width = pixels
    count = 0
    for i in range(edges.size):
        p = edges[i]
        if label[p] != FREE:
            continue
        turned, borders = np.float32(0), 0
        while turned < GROUP_TURN:
            label[p] = count
            for row in range(p - width, p + width + 1, width):
                for q in range(row - 1, row + 2):
                    if label[q] == FREE and seen_by[q] != count:
                        seen_by[q] = count
                        border[borders] = q
                        turns[borders] = turn(orientation[q], orientation[p])
                        borders += 1
            if borders == 0:
                break
            best = 0
            for b in range(1, borders):
                if turns[b] < turns[best]:
                    best = b
            p = border[best]
            turned += turns[best]
            borders -= 1
            border[best] = border[borders]
            turns[best] = turns[borders]
        count += 1
    return count


@kernel()
def _absorb_small(
    pixels: EdgePixels,
    min_total: np.float32,
    label: NDArray[np.int32],
    total: NDArray[np.float32],
    number: NDArray[np.int32],
    pending: NDArray[np.int64],
) -> int:
    """Give the pixels of weak groups to the bordering group of least turn; renumber the others, and return their count.

    Pixels that border on no other group end as NONE. total, number: 0 and NONE for each group; pending: buffer for
    pixels without a group.
    """
    magnitude, orientation, edges, width = pixels
    for i in range(edges.size):
        total[label[edges[i]]] += magnitude[edges[i]]
    kept = 0
    for g in range(total.size):
        if total[g] > min_total:
            number[g] = kept
            kept += 1
    left = 0
    for i in range(edges.size):
        p = edges[i]
        new = number[label[p]]
        label[p] = new
        if new == NONE:
            label[p] = FREE
            pending[left] = p
            left += 1
    before = left + 1
    while left < before:
        before, left = left, 0
        for k in range(before):
            p = pending[k]
            best = np.float32(2)
            for row in range(p - width, p + width + 1, width):
                for q in range(row - 1, row + 2):
                    if label[q] >= 0:
                        t = turn(orientation[q], orientation[p])
                        if t < best:
                            best = t
                            label[p] = label[q]
            if best == np.float32(2):
                pending[left] = p
                left += 1
    for k in range(left):
        label[pending[k]] = NONE
    return kept


@kernel()
def _describe(
    pixels: EdgePixels,
    label: NDArray[np.int32],
    total: NDArray[np.float32],
    mean: NDArray[np.float32],
    normal: NDArray[np.float32],
    last: NDArray[np.int64],
) -> None:
    """Each group's total magnitude, mean place and mean unit normal (n, 2), and last pixel; all are 0 before."""
    magnitude, orientation, edges, width = pixels
    for i in range(edges.size):
        p = edges[i]
        g = label[p]
        if g < 0:
            continue
        m = magnitude[p]
        total[g] += m
        mean[g, 0] += m * (p % width)
        mean[g, 1] += m * (p // width)
        # Orientations have period pi, so the mean is taken of the doubled angle.
        angle = np.float32(2) * orientation[p]
        normal[g, 0] += m * np.cos(angle)
        normal[g, 1] += m * np.sin(angle)
        last[g] = p
    for g in range(total.size):
        mean[g, 0] /= total[g]
        mean[g, 1] /= total[g]
        angle = np.arctan2(normal[g, 1], normal[g, 0]) / np.float32(2)
        normal[g, 0], normal[g, 1] = np.cos(angle), np.sin(angle)
