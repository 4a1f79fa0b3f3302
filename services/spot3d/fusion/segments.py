"""Split a surface at its concave creases: where two objects touch, or an object stands on something.

Real objects are mostly convex, and the seam between two that touch is concave (Stein et al., *Convexity based
object partitioning for robot applications*, ICRA 2014). Where the paper clusters by density alone, and merges
neighbours that touch, this also looks at the surface's shape.
"""

import numba as nb
import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.surface import Surface, near_pairs

_LIKE = np.float32(0.9)
"""Normals within this cosine (26 degrees) smooth each other."""
_CONVEX = np.float32(-20.0)
"""A pair counts as no more convex than this (1/m), so that a convex edge does not hide the crease that it meets."""
_LINK = 1.6
"""Cells whose centres are within this many cell edges are connected: touching cubes, but for most corners."""
_ROUNDS = 12
"""Cells of a crease join the segments beside it within this many cells."""


def smooth_normals(normals: NDArray[np.float32], pairs: NDArray[np.int32]) -> NDArray[np.float32]:
    """(n, 3) float32 unit normals averaged with those of near cells that face alike: noise falls, creases stay."""
    smoothed: NDArray[np.float32] = _smooth(normals, pairs)
    return smoothed


def concavity(
    centre: NDArray[np.float32], normals: NDArray[np.float32], pairs: NDArray[np.int32]
) -> NDArray[np.float32]:
    """(n,) float32 mean curvature towards the near cells, 1/m: positive in a hollow or crease, negative on a ball."""
    bend: NDArray[np.float32] = _concavity(centre, normals, pairs)
    return bend


def split_at_creases(surface: Surface, flat: NDArray[np.bool_], crease: float, smallest: int) -> NDArray[np.int32]:
    """Segments of a surface: connected regions without a crease, then the crease cells shared out.

    flat: (n,) bool, cells of thin flat things, which form regions of their own: what lies on a table does not hold
    together what stands on it. crease: concavity (1/m) from which a cell is a crease. smallest: cells a region
    needs to count. Returns (n,) int32 segment of each cell.
    """
    pairs = near_pairs(surface)
    link = _links(surface, pairs)
    core = concavity(surface.centre, smooth_normals(surface.normal, pairs), pairs) < crease
    labels = connected_cells(link[flat[link[:, 0]] == flat[link[:, 1]]], core)
    size = np.bincount(labels[core], minlength=1)
    labels[core & (size[np.maximum(labels, 0)] < smallest)] = -1
    _share_out(labels, link)
    left = labels < 0
    rest = connected_cells(link, left)
    labels[left] = rest[left] + len(labels)
    return np.unique(labels, return_inverse=True)[1].astype(np.int32)


def connected_cells(link: NDArray[np.int32], member: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Connected components of the members over linked pairs: (n,) int32, -1 for the others."""
    labels: NDArray[np.int32] = _components(link, member)
    return labels


def _links(surface: Surface, pairs: NDArray[np.int32]) -> NDArray[np.int32]:
    """The pairs whose cells touch."""
    touching: NDArray[np.int32] = _closer(surface.centre, pairs, np.float32((_LINK * surface.edge) ** 2))
    return touching


@nb.njit("i4[:,::1](f4[:,::1], i4[:,::1], f4)", cache=True, nogil=True)
def _closer(centre: NDArray[np.float32], pairs: NDArray[np.int32], square: np.float32) -> NDArray[np.int32]:
    """The pairs whose centres are less than the root of `square` apart."""
    kept = np.empty_like(pairs)
    count = 0
    for k in range(len(pairs)):
        i, j = pairs[k]
        gap = np.float32(0)
        for axis in range(3):
            gap += (centre[i, axis] - centre[j, axis]) ** 2
        if gap < square:
            kept[count] = pairs[k]
            count += 1
    return kept[:count].copy()


@nb.njit("f4[:,::1](f4[:,::1], i4[:,::1])", cache=True, nogil=True)
def _smooth(normals: NDArray[np.float32], pairs: NDArray[np.int32]) -> NDArray[np.float32]:
    total = normals.copy()
    for k in range(len(pairs)):
        i, j = pairs[k]
        like = np.float32(0)
        for axis in range(3):
            like += normals[i, axis] * normals[j, axis]
        if like > _LIKE:
            for axis in range(3):
                total[i, axis] += normals[j, axis]
                total[j, axis] += normals[i, axis]
    for i in range(len(total)):
        length = np.sqrt(total[i, 0] ** 2 + total[i, 1] ** 2 + total[i, 2] ** 2)
        if length > 0:
            for axis in range(3):
                total[i, axis] /= length
    return total


@nb.njit("f4[::1](f4[:,::1], f4[:,::1], i4[:,::1])", cache=True, nogil=True)
def _concavity(
    centre: NDArray[np.float32], normals: NDArray[np.float32], pairs: NDArray[np.int32]
) -> NDArray[np.float32]:
    total = np.zeros(len(centre), np.float32)
    count = np.zeros(len(centre), np.float32)
    for k in range(len(pairs)):
        i, j = pairs[k]
        turn, square = np.float32(0), np.float32(1e-9)
        for axis in range(3):
            d = centre[j, axis] - centre[i, axis]
            turn -= (normals[j, axis] - normals[i, axis]) * d
            square += d * d
        bend = max(turn / square, _CONVEX)
        total[i] += bend
        total[j] += bend
        count[i] += np.float32(1)
        count[j] += np.float32(1)
    for i in range(len(total)):
        total[i] /= max(count[i], np.float32(1))
    return total


@nb.njit("i4[::1](i4[:,::1], b1[::1])", cache=True, nogil=True)
def _components(link: NDArray[np.int32], member: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Union-find with path halving; the smaller number is the root, so that labels do not depend on order."""
    n = len(member)
    root = np.arange(n).astype(np.int32)
    for k in range(len(link)):
        i, j = link[k]
        if not (member[i] and member[j]):
            continue
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        while root[j] != j:
            root[j] = root[root[j]]
            j = root[j]
        if i < j:
            root[j] = i
        else:
            root[i] = j
    labels = np.full(n, -1, np.int32)
    count = 0
    for i in range(n):
        if member[i]:
            r = i
            while root[r] != r:
                r = root[r]
            if labels[r] < 0:
                labels[r] = count
                count += 1
            labels[i] = labels[r]
    return labels


@nb.njit("void(i4[::1], i4[:,::1])", cache=True, nogil=True)
def _share_out(labels: NDArray[np.int32], link: NDArray[np.int32]) -> None:
    """Give cells without a label that of a labelled neighbour, ring by ring (of several, the lowest)."""
    for _ in range(_ROUNDS):
        reached = labels.copy()
        changed = False
        for k in range(len(link)):
            for side in range(2):
                i, j = link[k, side], link[k, 1 - side]
                if labels[i] < 0 and labels[j] >= 0 and (reached[i] < 0 or labels[j] < reached[i]):
                    reached[i] = labels[j]
                    changed = True
        labels[:] = reached
        if not changed:
            break
