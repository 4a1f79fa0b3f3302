"""Join fragments, regions too small to have a shape, with the region beside them."""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.segments.nearness import apart

_ROUNDS = 3
"""Fragments join fragments first: a pen torn into five is one region after three rounds."""


def join_fragments(
    labels: NDArray[np.int32], points: NDArray[np.float32], focal: float, least: int, gap: float
) -> NDArray[np.int32]:
    """The labels after joining regions of fewer than `least` pixels with the nearest one within `gap` metres, if any.

    labels: (h, w) int32 from 0, -1 = no object; points: (h, w, 3) float32, camera frame; focal: pixels. If nothing else
    is known of a region, a gap smaller than the smallest object does not separate it, as in density clustering.
    """
    for _ in range(_ROUNDS):
        count = int(labels.max(initial=-1)) + 1
        size = np.bincount(labels[labels >= 0], minlength=count).astype(np.int32)
        nearest, square = np.full(count, -1, np.int32), np.full(count, gap**2, np.float32)
        _find_nearest(labels, points, size, least, np.float32(gap * focal), nearest, square)
        if (nearest < 0).all():
            break
        root = np.append(np.arange(count), -1).astype(np.int32)  # the last entry is for label -1
        order = np.argsort(size, kind="stable")
        for fragment in order[nearest[order] >= 0].tolist():
            root[root == root[fragment]] = root[nearest[fragment]]
        labels = root.take(labels)
    return labels


@kernel("void(i4[:,::1], f4[:,:,::1], i4[::1], i8, f4, i4[::1], f4[::1])")
def _find_nearest(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    size: NDArray[np.int32],
    least: int,
    reach: np.float32,
    nearest: NDArray[np.int32],
    square: NDArray[np.float32],
) -> None:
    """For each region smaller than `least`, find the one with the nearest point, nearer than the root of `square`.

    reach: search radius at the range of 1 m, pixels.
    """
    h, w = labels.shape
    for v in range(h):
        for u in range(w):
            own = labels[v, u]
            if own < 0 or size[own] >= least:
                continue
            far = int(reach / points[v, u, 2]) + 1
            for y in range(max(0, v - far), min(h, v + far + 1)):
                for x in range(max(0, u - far), min(w, u + far + 1)):
                    other = labels[y, x]
                    if other >= 0 and other != own:
                        distance, _ = apart(points, v, u, y, x)
                        if distance < square[own]:
                            square[own], nearest[own] = distance, other
