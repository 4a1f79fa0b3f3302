"""Split a surface at its concave creases: where two objects touch, or an object stands on something.

Real objects are mostly convex, and the seam between two that touch is concave (Stein et al., *Convexity based
object partitioning for robot applications*, ICRA 2014). Where the paper clusters by density alone, and merges
neighbours that touch, this also looks at the surface's shape.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.surface import Surface, near_pairs
from spot3d.kernel import kernel

_LIKE = np.float32(0.9)
"""Normals within this cosine (26 degrees) smooth each other."""
_CONVEX = np.float32(-20.0)
"""A pair counts as no more convex than this (1/m), so that a convex edge does not hide the crease that it meets."""
_FAINT = 0.5
"""A crease is followed where it has this share of the concavity that begins one: noise and gaps blur its ends."""
_SHARP = 0.1
"""Share of a crease's cells that must have all of that concavity."""
_LINK = 1.6
"""Cells whose centres are within this many cell edges are connected: touching cubes, but for most corners."""
_ROUNDS = 12
"""Cells of a crease join the segments beside it within this many cells."""


def smooth_normals(normals: NDArray[np.float32], pairs: NDArray[np.uint32]) -> NDArray[np.float32]:
    """(n, 3) float32 unit normals averaged with those of near cells that face alike: noise falls, creases stay."""
    total = normals.copy()
    _smooth(normals, pairs, total)
    return total


def concavity(
    centre: NDArray[np.float32], normals: NDArray[np.float32], pairs: NDArray[np.uint32]
) -> NDArray[np.float32]:
    """(n,) float32 mean curvature towards the near cells, 1/m: positive in a hollow or crease, negative on a ball."""
    bend, count = np.zeros(len(centre), np.float32), np.zeros(len(centre), np.float32)
    _concavity(centre, normals, pairs, bend, count)
    bend /= np.maximum(count, 1)
    return bend


def split_at_creases(
    surface: Surface,
    member: NDArray[np.bool_],
    flat: NDArray[np.bool_],
    crease: float,
    smallest: int,
    smallest_seamed: int,
) -> NDArray[np.int32]:
    """Segments of a surface: connected regions without a crease, then the crease cells shared out.

    member: (n,) bool, cells that are looked at. flat: (n,) bool, cells of thin flat things, which form regions of
    their own: what lies on a table does not hold together what stands on it. crease: concavity (1/m) from which a
    cell is a crease. smallest: cells a region needs to count; smallest_seamed: where it ends at a faint crease.
    Returns (n,) int32 segment of each cell, -1 = no member; a number between may be no cell's.
    """
    pairs = near_pairs(surface, member)
    link = _links(surface, pairs)
    bend = concavity(surface.centre, smooth_normals(surface.normal, pairs), pairs)
    sharp = member & (bend >= crease)
    kind = np.uint8(1) + flat.view(np.uint8)
    whole = connected_cells(link, (member & ~sharp) * kind, smallest)
    part = connected_cells(
        link, (member & ~_traced(link, member & (bend >= _FAINT * crease), sharp)) * kind, smallest_seamed
    )
    divided = np.zeros(whole.max(initial=-1) + 2, np.bool_)
    divided[whole[part >= 0]] = True
    undivided = (whole >= 0) & ~divided[whole]
    labels = np.where(undivided, whole + part.max(initial=-1) + 1, part)
    share_out(labels, link)
    left = member & (labels < 0)
    rest = connected_cells(link, left.view(np.uint8))
    return np.where(left, rest + labels.max(initial=-1) + 1, labels)


def _traced(link: NDArray[np.uint32], faint: NDArray[np.bool_], sharp: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) bool: the faint creases of which a good part is sharp, traced as edges in images are (Canny, 1986)."""
    line = connected_cells(link, faint.view(np.uint8))
    count = line.max(initial=-1) + 2
    meant = np.bincount(line[sharp], minlength=count) > _SHARP * np.bincount(line[faint], minlength=count)
    return np.asarray(meant[line])


def connected_cells(link: NDArray[np.uint32], group: NDArray[np.uint8], smallest: int = 1) -> NDArray[np.int32]:
    """Connected components over linked pairs of cells of the same group: (n,) int32.

    -1 for cells of group 0 and of components with fewer than `smallest` cells.
    """
    labels: NDArray[np.int32] = _components(link, group, smallest)
    return labels


def _links(surface: Surface, pairs: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The pairs whose cells touch."""
    touching = np.empty_like(pairs)
    return touching[: _closer(surface.centre, pairs, np.float32((_LINK * surface.edge) ** 2), touching)]


@kernel("i8(f4[:,::1], u4[:,::1], f4, u4[:,::1])")
def _closer(
    centre: NDArray[np.float32], pairs: NDArray[np.uint32], square: np.float32, kept: NDArray[np.uint32]
) -> int:
    """The pairs whose centres are less than the root of `square` apart, and how many they are."""
    count = 0
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        gap = np.float32(0)
        for axis in range(3):
            gap += (centre[i, axis] - centre[j, axis]) ** 2
        kept[count, 0], kept[count, 1] = i, j
        count += int(gap < square)
    return count


@kernel("void(f4[:,::1], u4[:,::1], f4[:,::1])")
def _smooth(normals: NDArray[np.float32], pairs: NDArray[np.uint32], total: NDArray[np.float32]) -> None:
    """Add to each normal in `total` those of near cells that face alike; make them unit again."""
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
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


@kernel("void(f4[:,::1], f4[:,::1], u4[:,::1], f4[::1], f4[::1])")
def _concavity(
    centre: NDArray[np.float32],
    normals: NDArray[np.float32],
    pairs: NDArray[np.uint32],
    total: NDArray[np.float32],
    count: NDArray[np.float32],
) -> None:
    """Sum of the curvatures towards the near cells, and their number."""
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
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


@kernel("i4[::1](u4[:,::1], u1[::1], i8)")
def _components(link: NDArray[np.uint32], group: NDArray[np.uint8], smallest: int) -> NDArray[np.int32]:
    """Union-find with path halving; the smaller number is the root, so that labels do not depend on order."""
    n = len(group)
    root = np.arange(n).astype(np.uint32)
    for k in range(len(link)):
        i, j = link[k, 0], link[k, 1]
        if group[i] == 0 or group[i] != group[j]:
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
    size, labels = np.zeros(n, np.int32), np.full(n, -1, np.int32)
    for i in range(n):
        root[i] = root[root[i]]  # all before are found already, and a root comes before its cells
        size[root[i]] += 1
    count = 0
    for i in range(n):
        if group[i] > 0 and size[root[i]] >= smallest:
            if root[i] == i:
                labels[i] = count
                count += 1
            labels[i] = labels[root[i]]
    return labels


@kernel("void(i4[::1], u4[:,::1])")
def share_out(labels: NDArray[np.int32], link: NDArray[np.uint32]) -> None:
    """Give cells without a label that of a labelled neighbour, ring by ring (of several, the lowest)."""
    open_link = link.copy()
    count = len(link)
    for _ in range(_ROUNDS):
        reached = labels.copy()
        kept = 0
        changed = False
        for k in range(count):
            i, j = open_link[k, 0], open_link[k, 1]
            if labels[i] >= 0 and labels[j] >= 0:
                continue
            open_link[kept, 0], open_link[kept, 1] = i, j
            kept += 1
            if labels[i] >= 0:
                i, j = j, i
            if labels[j] >= 0 and (reached[i] < 0 or labels[j] < reached[i]):
                reached[i] = labels[j]
                changed = True
        count = kept
        labels[:] = reached
        if not changed:
            break
