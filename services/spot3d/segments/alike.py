"""Join regions that meet at a crease and are of one colour: the neck of a thing, not the seam of two."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.segments.nearness import within

_CHROMA, _LIGHTNESS = 6.0, 15.0
"""Mean colours that differ by less, CIE L*a*b*, are one in two lights: how a surface is turned changes its lightness
most. Success, detection and boxes of no object on ten rendered desks: 0.70, 0.73, 2.3 a desk where colour is not looked
at, 0.73, 0.74, 1.7 with half of both, 0.75, 0.74, 1.5 with these and with half more. Clutter, OSD, HOTS, redkitchen and
TUM's cabinet are alike in all of these, to a box in a hundred; with twice both, OSD's success falls by 0.001."""


def join_alike(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    bend: NDArray[np.float32],
    colour: NDArray[np.uint8],
    sharp: float,
    link: float,
) -> NDArray[np.int32]:
    """The labels with those regions made one that meet in no sharp crease and are of one colour.

    labels: (h, w) int32 from 0 without gaps, -1 = none; points: (h, w, 3) float32, camera frame; bend: (h, w) float32,
    concavity; colour: (h, w, 3) uint8 RGB; sharp: the mean concavity from which a crease parts;
    link: pixels meet within this share of their range.
    """
    count = int(labels.max(initial=-1)) + 1
    if count < 2:
        return labels
    met, total = np.zeros((count, count), np.int32), np.zeros((count, count), np.float32)
    _meet(labels, points, bend, np.float32(link), met, total)
    inside = labels >= 0
    numbers = labels[inside]
    lab = cv2.cvtColor(colour.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[inside]
    size = np.bincount(numbers, minlength=count)
    mean = np.array([np.bincount(numbers, lab[:, k], count) / size for k in range(3)])
    root = np.arange(count)
    for a, b in np.argwhere(total < sharp * met).tolist():
        lightness, *chroma = mean[:, a] - mean[:, b]
        if abs(lightness) < _LIGHTNESS and np.hypot(*chroma) < _CHROMA:
            low, high = sorted((int(root[a]), int(root[b])))
            root[root == high] = low
    return np.where(inside, np.unique(root, return_inverse=True)[1][labels], -1).astype(np.int32)


@kernel("void(i4[:,::1], f4[:,:,::1], f4[:,::1], f4, i4[:,::1], f4[:,::1])")
def _meet(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    bend: NDArray[np.float32],
    link: np.float32,
    met: NDArray[np.int32],
    total: NDArray[np.float32],
) -> None:
    """Add up, for each two regions, the pairs of near pixels in which they meet, and the concavity there.

    met, total: (n, n), of which those above the diagonal are used.
    """
    h, w = labels.shape
    for v in range(h):
        for u in range(w):
            a = labels[v, u]
            if a < 0:
                continue
            for y, x in ((v, u + 1), (v + 1, u), (v, u + 2), (v + 2, u)):
                if y >= h or x >= w:
                    continue
                b = labels[y, x]
                if b >= 0 and b != a and within(points, v, u, y, x, link):
                    low, high = min(a, b), max(a, b)
                    met[low, high] += 1
                    total[low, high] += np.float32(0.5) * (bend[v, u] + bend[y, x])
