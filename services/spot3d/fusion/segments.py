"""Split a surface at its concave creases: where two objects touch, or an object stands on something.

Real objects are mostly convex, and the seam between two that touch is concave (Stein et al., *Convexity based
object partitioning for robot applications*, ICRA 2014). Where the paper clusters by density alone, and merges
neighbours that touch, this also looks at the surface's shape.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.components import copy_links, in_good_part, join, label, refined, share_out
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


def smooth_normals(normals: NDArray[np.float32], pairs: NDArray[np.uint32]) -> NDArray[np.float32]:
    """(n, 3) float32 unit normals averaged with those of near cells that face alike: noise falls, creases stay."""
    total = normals.copy()
    _smooth(normals, pairs, total)
    return total


def concavity(
    surface: Surface, normals: NDArray[np.float32], pairs: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """(n,) float32 mean curvature towards the near cells, 1/m: positive in a hollow or crease, negative on a ball.

    And the pairs whose cells touch, (m, 2). normals: (n, 3) float32, smoothed; pairs: near cells.
    """
    bend, count = np.zeros(len(normals), np.float32), np.zeros(len(normals), np.float32)
    link, reach = np.empty_like(pairs), np.float32((_LINK * surface.edge) ** 2)
    links: int = _concavity(surface.centre, normals, pairs, reach, bend, count, link)
    bend /= np.maximum(count, 1)
    return bend, link[:links]


def split_at_creases(
    surface: Surface,
    flat: NDArray[np.bool_],
    crease: float,
    smallest: int,
    smallest_seamed: int,
) -> NDArray[np.int32]:
    """Segments of a surface: connected regions without a crease, then the crease cells shared out.

    flat: (n,) bool, cells of thin flat things, which form regions of their own: what lies on a table does not hold
    together what stands on it. crease: concavity (1/m) from which a cell is a crease. smallest: cells a region needs
    to count; smallest_seamed: where it ends at a faint crease.
    Returns (n,) int32 segment of each cell; a number between may be no cell's.
    """
    pairs = near_pairs(surface)
    bend, link = concavity(surface, smooth_normals(surface.normal, pairs), pairs)
    sharp, faint = bend >= crease, bend >= _FAINT * crease
    kind = np.uint8(1) + flat.view(np.uint8)
    # Most of a surface is far from any crease: what is connected there is found once.
    calm = np.arange(len(bend), dtype=np.uint32)
    join(calm, link, ~faint * kind)
    link_of_crease = _links_of(link, faint)
    traced = _traced(link_of_crease, faint, sharp)

    def regions(left_out: NDArray[np.bool_], least: int) -> NDArray[np.int32]:
        root, group = calm.copy(), ~left_out * kind
        join(root, link_of_crease, group)
        return np.asarray(label(root, group, least))

    labels = refined(regions(sharp, smallest), regions(traced, smallest_seamed))
    open_link = share_out(labels, link)
    left = labels < 0
    rest = connected_cells(open_link, left.view(np.uint8))
    return np.where(left, rest + labels.max(initial=-1) + 1, labels)


def _links_of(link: NDArray[np.uint32], faint: NDArray[np.bool_]) -> NDArray[np.uint32]:
    """The links of one of these cells at least."""
    kept = np.empty_like(link)
    return kept[: copy_links(link, faint, kept)]


def _traced(link: NDArray[np.uint32], faint: NDArray[np.bool_], sharp: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) bool: the faint creases of which a good part is sharp, traced as edges in images are (Canny, 1986)."""
    root = np.arange(len(faint), dtype=np.uint32)
    join(root, link, faint.view(np.uint8))
    return np.asarray(in_good_part(root, faint, sharp, _SHARP))


def connected_cells(link: NDArray[np.uint32], group: NDArray[np.uint8], smallest: int = 1) -> NDArray[np.int32]:
    """Connected components over linked pairs of cells of the same group: (n,) int32.

    -1 for cells of group 0 and of components with fewer than `smallest` cells.
    """
    root = np.arange(len(group), dtype=np.uint32)
    join(root, link, group)
    return np.asarray(label(root, group, smallest))


@kernel("void(f4[:,::1], u4[:,::1], f4[:,::1])")
def _smooth(normals: NDArray[np.float32], pairs: NDArray[np.uint32], total: NDArray[np.float32]) -> None:
    """Add to each normal in `total` those of near cells that face alike; make them unit again."""
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        like = np.float32(0)
        for axis in range(3):
            like += normals[i, axis] * normals[j, axis]
        alike = np.float32(like > _LIKE)  # no branch, which would often be guessed wrong
        for axis in range(3):
            total[i, axis] += alike * normals[j, axis]
            total[j, axis] += alike * normals[i, axis]
    for i in range(len(total)):
        square = total[i, 0] ** 2 + total[i, 1] ** 2 + total[i, 2] ** 2
        scale = np.float32(1) / np.sqrt(max(square, np.float32(1e-12)))
        for axis in range(3):
            total[i, axis] *= scale


@kernel("i8(f4[:,::1], f4[:,::1], u4[:,::1], f4, f4[::1], f4[::1], u4[:,::1])")
def _concavity(
    centre: NDArray[np.float32],
    normals: NDArray[np.float32],
    pairs: NDArray[np.uint32],
    reach: np.float32,
    total: NDArray[np.float32],
    count: NDArray[np.float32],
    link: NDArray[np.uint32],
) -> int:
    """Sum of the curvatures towards the near cells, and their number.

    Enters the pairs whose centres are less than the root of `reach` apart into `link`, and says how many they are.
    """
    links = 0
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        turn, square = np.float32(0), np.float32(0)
        for axis in range(3):
            d = centre[j, axis] - centre[i, axis]
            turn -= (normals[j, axis] - normals[i, axis]) * d
            square += d * d
        bend = max(turn / (square + np.float32(1e-9)), _CONVEX)
        total[i] += bend
        total[j] += bend
        count[i] += np.float32(1)
        count[j] += np.float32(1)
        link[links, 0], link[links, 1] = i, j
        links += int(square < reach)
    return links
