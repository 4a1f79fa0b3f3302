"""Join regions whose seam as a whole is no crease, or that share a colour: a neck of one object, not two objects."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.segments.labels import united
from spot3d.segments.nearness import within

_CHROMA, _LIGHTNESS = 6.0, 15.0
"""Mean colours (CIE L*a*b*) that differ by less are one colour in different light: a surface's direction changes its
lightness most. Success, detection and boxes of no object per desk on ten rendered desks: 0.70, 0.73, 2.3 without
colour; 0.73, 0.74, 1.7 with half of both; 0.75, 0.74, 1.5 with these and with 1.5 times both. Clutter, OSD, HOTS,
redkitchen and TUM's cabinet: the same, to one box in a hundred; with twice both, OSD's success falls by 0.001."""


def join_at_seams(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    bend: NDArray[np.float32],
    colour: NDArray[np.uint8] | None,
    crease: float,
    sharp: float,
    link: float,
) -> NDArray[np.int32]:
    """The labels after joining regions whose seam as a whole is no crease, or no sharp one if they have one colour.

    labels: (h, w) int32 from 0 without gaps, -1 = none; points: (h, w, 3) float32, camera frame; bend: (h, w) float32,
    concavity; colour: (h, w, 3) uint8 RGB, None = ignored; crease, sharp: mean concavity along a seam from which it
    separates regions of different colours, and of one colour; link: pixels meet within this share of their range.
    """
    count = int(labels.max(initial=-1)) + 1
    if count < 2:
        return labels
    met, total = np.zeros((count, count), np.int32), np.zeros((count, count), np.float32)
    _meet(labels, points, bend, np.float32(link), met, total)
    inside = labels >= 0
    one = total < crease * met
    if colour is not None:
        one |= (total < sharp * met) & _alike(labels[inside], colour[inside], count)
    return united(labels, np.argwhere(one), count)


def _alike(labels: NDArray[np.int32], colour: NDArray[np.uint8], count: int) -> NDArray[np.bool_]:
    """(count, count) bool: which regions have one colour. labels, colour: (n,) and (n, 3) RGB of the same pixels."""
    lab = cv2.cvtColor(colour[None].astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[0]
    size = np.bincount(labels, minlength=count)
    mean = np.stack([np.bincount(labels, lab[:, k], count) / size for k in range(3)], axis=1)
    lightness, *chroma = np.abs(mean[:, None] - mean[None]).transpose(2, 0, 1)
    return np.asarray((lightness < _LIGHTNESS) & (np.hypot(*chroma) < _CHROMA))


@kernel("void(i4[:,::1], f4[:,:,::1], f4[:,::1], f4, i4[:,::1], f4[:,::1])")
def _meet(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    bend: NDArray[np.float32],
    link: np.float32,
    met: NDArray[np.int32],
    total: NDArray[np.float32],
) -> None:
    """For each two regions, count the pairs of near pixels in which they meet, and sum the concavity there.

    met, total: (n, n), used above the diagonal.
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
