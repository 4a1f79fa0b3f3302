"""How well one edge group continues another (EdgeBoxes, Sec. 3.1, Eq. 1)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

REACH = 2  # groups that come this close, in pixels along both axes, have an affinity
MIN_AFFINITY = 0.05  # paths of a lower affinity do not connect
PAIRS = 16  # pairs per group for which memory is allocated at first


def affinities(
    label: NDArray[np.int32],
    edges: NDArray[np.int64],
    mean: NDArray[np.float32],
    normal: NDArray[np.float32],
    gamma: float,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Affinity |cos(t_i - t_ij) cos(t_j - t_ij)|^gamma of groups that come within REACH (EdgeBoxes, Eq. 1).

    t_i, t_j: directions of the groups, across their normals, t_ij: of the line between their means. label: (h, w)
    int32, -1 = no group; edges: (e,) int64, flat indices of the pixels that may have one; mean, normal: (n, 2) float32.
    Returns the sparse rows `first`, `neighbour` and `affinity` of EdgeGroups: those of at least MIN_AFFINITY.
    """
    group = label.reshape(-1)[edges]
    pixels = edges[group >= 0]
    size = np.bincount(group[group >= 0], minlength=len(mean))
    sorted_pixels, start = np.empty_like(pixels), np.append(np.cumsum(size), pixels.size)
    _sort_by_group(label.reshape(-1), pixels, start, sorted_pixels)
    groups = _Groups(sorted_pixels, start, mean, normal)
    room = PAIRS * (len(mean) + 1)
    while True:
        first, met = np.zeros(len(mean) + 1, np.int32), np.full(len(mean), -1, np.int32)
        rows = _Rows(first, np.empty(room, np.int32), np.empty(room, np.float32))
        n = _affinities(label, groups, np.float32(gamma), met, rows)
        if n <= room:
            return first, rows.neighbour[:n], rows.affinity[:n]
        room = n


class _Groups(NamedTuple):
    """Group g has pixels[start[g] : start[g + 1]]; mean, normal: as `affinities` has them."""

    pixels: NDArray[np.int64]
    start: NDArray[np.int64]
    mean: NDArray[np.float32]
    normal: NDArray[np.float32]


class _Rows(NamedTuple):
    """The sparse rows of EdgeGroups."""

    first: NDArray[np.int32]
    neighbour: NDArray[np.int32]
    affinity: NDArray[np.float32]


@kernel()
def _sort_by_group(
    label: NDArray[np.int32], pixels: NDArray[np.int64], start: NDArray[np.int64], sorted_pixels: NDArray[np.int64]
) -> None:
    """Counting sort. start: (n + 1,), where each group ends, afterwards where it starts."""
    for i in range(pixels.size - 1, -1, -1):
        g = label[pixels[i]]
        start[g] -= 1
        sorted_pixels[start[g]] = pixels[i]


@kernel()
def _affinities(
    label: NDArray[np.int32], groups: _Groups, gamma: np.float32, met: NDArray[np.int32], rows: _Rows
) -> int:
    """Write the sparse rows as far as they fit; returns the number of entries that they need.

    met: -1 for each group, then the last group that met it.
    """
    pixels, start, mean, normal = groups
    first, neighbour, affinity = rows
    h, w = label.shape
    n = 0
    for g in range(met.size):
        for k in range(start[g], start[g + 1]):
            y, x = pixels[k] // w, pixels[k] % w
            top, bottom = y - REACH if y > REACH else 0, y + REACH + 1 if y + REACH < h else h
            left, right = x - REACH if x > REACH else 0, x + REACH + 1 if x + REACH < w else w
            for v in range(top, bottom):
                for u in range(left, right):
                    q = label[v, u]
                    if q < 0 or q == g or met[q] == g:
                        continue
                    met[q] = g
                    dx, dy = mean[q, 0] - mean[g, 0], mean[q, 1] - mean[g, 1]
                    # Dot products of the groups' directions with the line between their means.
                    ours, theirs = normal[g, 1] * dx - normal[g, 0] * dy, normal[q, 1] * dx - normal[q, 0] * dy
                    squared = dx * dx + dy * dy
                    if squared < np.float32(1e-12):
                        squared = np.float32(1e-12)
                    a = (abs(ours * theirs) / squared) ** gamma
                    if a < np.float32(MIN_AFFINITY):
                        continue
                    place = n
                    n += 1
                    if n > neighbour.size:
                        continue
                    while place > first[g] and affinity[place - 1] < a:
                        neighbour[place], affinity[place] = neighbour[place - 1], affinity[place - 1]
                        place -= 1
                    neighbour[place], affinity[place] = q, a
        first[g + 1] = n
    return n
