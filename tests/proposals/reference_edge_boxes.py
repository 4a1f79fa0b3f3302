"""EdgeBoxes' window score as the method's description reads, without any table: slow, for comparison."""

import numpy as np
from numpy.typing import NDArray

from spot3d.proposals.affinity import MIN_AFFINITY
from spot3d.proposals.groups import EdgeGroups


def affinity_matrix(groups: EdgeGroups) -> NDArray[np.float64]:
    """Affinities of all groups as a full matrix (n, n)."""
    n = groups.magnitude.size
    matrix = np.zeros((n, n))
    for g in range(n):
        row = slice(groups.first[g], groups.first[g + 1])
        matrix[g, groups.neighbour[row]] = groups.affinity[row]
    return matrix


def reference_score(
    magnitude: NDArray[np.float32], groups: EdgeGroups, window: tuple[int, int, int, int], kappa: float
) -> float:
    """Score of the window (x0, y0, x1, y1), ends excluded (Zitnick and Dollar, ECCV 2014, Eq. 2 to 4)."""
    x0, y0, x1, y1 = window
    w, h = x1 - x0, y1 - y0
    label = groups.label[y0:y1, x0:x1]
    on_border = np.unique(np.concatenate((label[0], label[-1], label[:, 0], label[:, -1])))
    on_border = on_border[on_border >= 0]
    inside = (groups.anchor[:, 0] >= x0) & (groups.anchor[:, 0] < x1)
    inside &= (groups.anchor[:, 1] >= y0) & (groups.anchor[:, 1] < y1)
    # Best product of affinities along a path from the border through groups inside.
    affinity = affinity_matrix(groups)
    connected = np.zeros(groups.magnitude.size)
    connected[on_border] = 1
    while True:
        reached = (connected[:, None] * affinity).max(axis=0, initial=0)
        reached[~inside | (reached < MIN_AFFINITY)] = 0
        if (reached <= connected).all():
            break
        connected = np.maximum(connected, reached)
    total = float(((1 - connected) * groups.magnitude)[inside].sum())
    x2, y2 = x0 + w // 4, y0 + h // 4
    centre = np.s_[y2 : y2 + h // 2, x2 : x2 + w // 2]
    total -= float(magnitude[centre][groups.label[centre] >= 0].sum())
    return max(total, 0) / ((w + h) / 2) ** kappa
