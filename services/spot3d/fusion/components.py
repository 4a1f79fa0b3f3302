"""Kernels of `segments`: connected components of cells, and what becomes of them."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part

_ROUNDS = 12
"""Cells of a crease join the segments beside it within this many cells."""


@part()
def root_of(root: NDArray[np.uint32], cell: np.uint32) -> np.uint32:
    """The root of a cell's tree; the way there is halved."""
    while root[cell] != cell:
        root[cell] = root[root[cell]]
        cell = root[cell]
    return cell


@kernel("void(u4[::1], u4[:,::1], u1[::1])")
def join(root: NDArray[np.uint32], link: NDArray[np.uint32], group: NDArray[np.uint8]) -> None:
    """Join the trees of linked cells of the same group, but for group 0: union-find with path halving.

    root: (n,) of each cell one that is nearer to its tree's root. That is the smallest number of the tree, so that
    labels do not depend on the links' order.
    """
    for k in range(len(link)):
        i, j = link[k, 0], link[k, 1]
        if group[i] == 0 or group[i] != group[j]:
            continue
        i, j = root_of(root, i), root_of(root, j)
        if i < j:
            root[j] = i
        else:
            root[i] = j


@kernel("i4[::1](u4[::1], u1[::1], i8)")
def label(root: NDArray[np.uint32], group: NDArray[np.uint8], smallest: int) -> NDArray[np.int32]:
    """The number of each cell's tree, in the order of their roots: (n,); -1 for group 0 and for trees too small."""
    n = len(group)
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


@kernel("b1[::1](u4[::1], b1[::1], b1[::1], f8)")
def in_good_part(
    root: NDArray[np.uint32], member: NDArray[np.bool_], good: NDArray[np.bool_], share: float
) -> NDArray[np.bool_]:
    """The members of trees of which more than a share of the members are good: (n,) bool."""
    size, goods = np.zeros(len(root), np.int32), np.zeros(len(root), np.int32)
    for i in range(len(root)):
        if member[i]:
            root[i] = root[root[i]]
            size[root[i]] += 1
            goods[root[i]] += good[i]
    found = np.zeros(len(root), np.bool_)
    for i in range(len(root)):
        if member[i]:
            found[i] = goods[root[i]] > share * size[root[i]]
    return found


@kernel("i4[::1](i4[::1], i4[::1])")
def refined(whole: NDArray[np.int32], part: NDArray[np.int32]) -> NDArray[np.int32]:
    """The regions of `part`, (n,) labels, and after them those of `whole` that hold none of these."""
    highest, parts = -1, -1
    for i in range(len(whole)):
        highest, parts = max(highest, whole[i]), max(parts, part[i])
    divided = np.zeros(highest + 1, np.bool_)
    for i in range(len(whole)):
        if whole[i] >= 0 and part[i] >= 0:
            divided[whole[i]] = True
    labels = part.copy()
    for i in range(len(whole)):
        if whole[i] >= 0 and not divided[whole[i]]:
            labels[i] = whole[i] + parts + 1
    return labels


@kernel("i8(u4[:,::1], b1[::1], u4[:,::1])")
def copy_links(link: NDArray[np.uint32], member: NDArray[np.bool_], kept: NDArray[np.uint32]) -> int:
    """Copy the links of one member at least, and say how many they are."""
    count = 0
    for k in range(len(link)):
        i, j = link[k, 0], link[k, 1]
        kept[count, 0], kept[count, 1] = i, j
        count += int(member[i] | member[j])
    return count


@kernel("u4[:,::1](i4[::1], u4[:,::1])")
def share_out(labels: NDArray[np.int32], link: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Give cells without a label that of a labelled neighbour, ring by ring (of several, the lowest).

    Returns links among which are all of those between two cells that are left without one.
    """
    open_link, count = np.empty_like(link), len(link)
    for k in range(len(link)):
        open_link[k, 0], open_link[k, 1] = link[k, 0], link[k, 1]
    reached, ring = labels.copy(), np.empty(len(labels), np.uint32)
    for _ in range(_ROUNDS):
        kept, new = 0, 0
        for k in range(count):
            i, j = open_link[k, 0], open_link[k, 1]
            if labels[i] >= 0 and labels[j] >= 0:
                continue
            open_link[kept, 0], open_link[kept, 1] = i, j
            kept += 1
            if labels[i] >= 0:
                i, j = j, i
            if labels[j] >= 0:
                if reached[i] < 0:
                    ring[new] = i
                    new += 1
                if reached[i] < 0 or labels[j] < reached[i]:
                    reached[i] = labels[j]
        count = kept
        for k in range(new):
            labels[ring[k]] = reached[ring[k]]
        if new == 0:
            break
    return open_link[:count].copy()
