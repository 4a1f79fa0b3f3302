"""Edge groups: short smooth pieces of contour, and how well one continues the other (EdgeBoxes, Sec. 3.1)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part

PI = np.float32(np.pi)
REACH = 2  # groups that come this close, in pixels along both axes, have an affinity


class EdgePixels(NamedTuple):
    """An edge map, magnitude and orientation (h, w) float32, and where it has edges.

    ys, xs: (e,) int32, the pixels above 0 in reading order, the image's border excepted.
    """

    magnitude: NDArray[np.float32]
    orientation: NDArray[np.float32]
    ys: NDArray[np.int32]
    xs: NDArray[np.int32]


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
    *,
    merge_threshold: float,
    min_group_magnitude: float,
    gamma: float,
    min_affinity: float,
) -> EdgeGroups:
    """Groups of the edge map's pixels, and their affinities of at least `min_affinity`.

    magnitude, orientation: (h, w) float32, orientation of the normal in [0, pi). merge_threshold: a group
    ends when its orientation differences sum to this, units of pi. min_group_magnitude: groups whose
    magnitudes sum to no more than this are given to their neighbours.
    """
    pixels = EdgePixels(magnitude, orientation, *edge_pixels(magnitude))
    label, count = cluster(pixels, np.float32(merge_threshold))
    count = absorb_small(pixels, label, count, np.float32(min_group_magnitude))
    total, mean, normal, anchor = describe(pixels, label, count)
    first, neighbour, affinity = affinities(pixels, label, mean, normal, np.float32(gamma), np.float32(min_affinity))
    return EdgeGroups(label, total, anchor, first, neighbour, affinity)


@kernel()
def edge_pixels(magnitude: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Rows and columns, (k,) int32 in reading order, of the pixels above 0, the image's border excepted."""
    h, w = magnitude.shape
    ys, xs = np.empty(h * w, np.int32), np.empty(h * w, np.int32)
    k = 0
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            if magnitude[y, x] > 0:
                ys[k], xs[k] = y, x
                k += 1
    return ys[:k].copy(), xs[:k].copy()


@part()
def turn(a: np.float32, b: np.float32) -> np.float32:
    """Difference of two orientations in [0, pi), units of pi: 0 to 0.5."""
    d = abs(a - b) / PI
    return d if d <= np.float32(0.5) else np.float32(1) - d


@kernel()
def cluster(pixels: EdgePixels, threshold: np.float32) -> tuple[NDArray[np.int32], int]:
    """Grow groups greedily: always the bordering pixel of least turn, until the turns sum to `threshold`.

    Returns labels (h, w) int32 (-1 = no edge) and the number of groups.
    """
    orientation, ys, xs = pixels.orientation, pixels.ys, pixels.xs
    h, w = orientation.shape
    free, none = -2, -1
    label = np.full((h, w), none, np.int32)
    seen_by = np.full((h, w), none, np.int32)  # the last group that has the pixel on its border
    border_y, border_x = np.empty(ys.size, np.int32), np.empty(ys.size, np.int32)
    border_turn = np.empty(ys.size, np.float32)
    for i in range(ys.size):
        label[ys[i], xs[i]] = free
    count = 0
    for i in range(ys.size):
        y, x = ys[i], xs[i]
        if label[y, x] != free:
            continue
        turned, borders = np.float32(0), 0
        while turned < threshold:
            label[y, x] = count
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    v, u = y + dy, x + dx
                    if label[v, u] == free and seen_by[v, u] != count:
                        seen_by[v, u] = count
                        border_y[borders], border_x[borders] = v, u
                        border_turn[borders] = turn(orientation[v, u], orientation[y, x])
                        borders += 1
            if borders == 0:
                break
            best = 0
            for b in range(1, borders):
                if border_turn[b] < border_turn[best]:
                    best = b
            y, x = border_y[best], border_x[best]
            turned += border_turn[best]
            borders -= 1
            border_y[best], border_x[best] = border_y[borders], border_x[borders]
            border_turn[best] = border_turn[borders]
        count += 1
    return label, count


@kernel()
def absorb_small(pixels: EdgePixels, label: NDArray[np.int32], count: int, min_total: np.float32) -> int:
    """Give the pixels of weak groups to the bordering group of least turn, and number the others anew.

    label: (h, w) int32, changed in place; pixels that border on no other group end as -1. Returns the new
    number of groups.
    """
    magnitude, orientation, ys, xs = pixels
    free, none = -2, -1
    total = np.zeros(count, np.float32)
    for i in range(ys.size):
        total[label[ys[i], xs[i]]] += magnitude[ys[i], xs[i]]
    number = np.full(count, none, np.int32)
    kept = 0
    for g in range(count):
        if total[g] > min_total:
            number[g] = kept
            kept += 1
    pending = np.empty(ys.size, np.int32)
    left = 0
    for i in range(ys.size):
        y, x = ys[i], xs[i]
        new = number[label[y, x]]
        label[y, x] = new
        if new == none:
            label[y, x] = free
            pending[left] = i
            left += 1
    before = left + 1
    while left < before:
        before, left = left, 0
        for k in range(before):
            i = pending[k]
            y, x = ys[i], xs[i]
            best = np.float32(2)
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    other = label[y + dy, x + dx]
                    if other >= 0:
                        t = turn(orientation[y + dy, x + dx], orientation[y, x])
                        if t < best:
                            best = t
                            label[y, x] = other
            if best == 2:
                pending[left] = i
                left += 1
    for k in range(left):
        label[ys[pending[k]], xs[pending[k]]] = none
    return kept


@kernel()
def describe(
    pixels: EdgePixels, label: NDArray[np.int32], count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    """Each group's total magnitude (n,), mean place (n, 2), mean unit normal (n, 2) and last pixel (n, 2)."""
    magnitude, orientation, ys, xs = pixels
    total, normal = np.zeros(count, np.float32), np.empty((count, 2), np.float32)
    mean, double = np.zeros((count, 2), np.float32), np.zeros((count, 2), np.float32)
    anchor = np.zeros((count, 2), np.int32)
    for i in range(ys.size):
        y, x = ys[i], xs[i]
        g = label[y, x]
        if g < 0:
            continue
        m = magnitude[y, x]
        total[g] += m
        mean[g, 0] += m * x
        mean[g, 1] += m * y
        # Orientations have period pi, so the mean is taken of the doubled angle.
        angle = np.float32(2) * orientation[y, x]
        double[g, 0] += m * np.cos(angle)
        double[g, 1] += m * np.sin(angle)
        anchor[g, 0], anchor[g, 1] = x, y
    for g in range(count):
        mean[g, 0], mean[g, 1] = mean[g, 0] / total[g], mean[g, 1] / total[g]
        angle = np.arctan2(double[g, 1], double[g, 0]) / np.float32(2)
        normal[g, 0], normal[g, 1] = np.cos(angle), np.sin(angle)
    return total, mean, normal, anchor


@kernel()
def affinities(
    pixels: EdgePixels,
    label: NDArray[np.int32],
    mean: NDArray[np.float32],
    normal: NDArray[np.float32],
    gamma: np.float32,
    least: np.float32,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Affinity |cos(t_i - t_ij) cos(t_j - t_ij)|^gamma of groups that come within REACH (EdgeBoxes, Eq. 1).

    t_i, t_j: directions of the groups, across their normals, t_ij: of the line between their means. Returns the
    sparse rows `first`, `neighbour` and `affinity` of EdgeGroups.
    """
    ys, xs = pixels.ys, pixels.xs
    h, w, count = *label.shape, mean.shape[0]
    size = np.zeros(count + 1, np.int32)
    for i in range(ys.size):
        size[label[ys[i], xs[i]] + 1] += 1
    start = np.zeros(count + 1, np.int32)  # pixels of each group, by counting sort
    for g in range(count):
        start[g + 1] = start[g] + size[g + 1]
    pixel, fill = np.empty(start[count], np.int32), start[:count].copy()
    for i in range(ys.size):
        g = label[ys[i], xs[i]]
        if g >= 0:
            pixel[fill[g]] = i
            fill[g] += 1
    first = np.zeros(count + 1, np.int32)
    neighbour, affinity = np.empty(16 * count + 16, np.int32), np.empty(16 * count + 16, np.float32)
    met = np.full(count, -1, np.int32)
    n = 0
    for g in range(count):
        for k in range(start[g], start[g + 1]):
            y, x = ys[pixel[k]], xs[pixel[k]]
            for v in range(max(y - REACH, 0), min(y + REACH + 1, h)):
                for u in range(max(x - REACH, 0), min(x + REACH + 1, w)):
                    q = label[v, u]
                    if q < 0 or q == g or met[q] == g:
                        continue
                    met[q] = g
                    dx, dy = mean[q, 0] - mean[g, 0], mean[q, 1] - mean[g, 1]
                    # Products of normals with the line's, whose length is the means' distance.
                    ours, theirs = normal[g, 1] * dx - normal[g, 0] * dy, normal[q, 1] * dx - normal[q, 0] * dy
                    a = (abs(ours * theirs) / max(dx * dx + dy * dy, np.float32(1e-12))) ** gamma
                    if a < least:
                        continue
                    if n == neighbour.size:
                        more, as_strong = np.empty(2 * n, np.int32), np.empty(2 * n, np.float32)
                        for old in range(n):
                            more[old], as_strong[old] = neighbour[old], affinity[old]
                        neighbour, affinity = more, as_strong
                    k_sorted = n
                    while k_sorted > first[g] and affinity[k_sorted - 1] < a:
                        neighbour[k_sorted], affinity[k_sorted] = (
                            neighbour[k_sorted - 1],
                            affinity[k_sorted - 1],
                        )
                        k_sorted -= 1
                    neighbour[k_sorted], affinity[k_sorted] = q, a
                    n += 1
        first[g + 1] = n
    return first, neighbour[:n].copy(), affinity[:n].copy()
