"""Join the pieces of one object that holes in depth tear apart.

Depth is missing on shiny and dark surfaces. Two pieces beside a hole are joined if their surfaces are near each other
there and form no crease (Stein et al., ICRA 2014).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.kernel import kernel
from spot3d.segments.labels import united
from spot3d.sensor import axial_noise_kernel

_GAP = 0.05
"""Surfaces farther apart than this across a hole are not joined, metres: holes of glare are mostly narrower."""
_STEEP = 3.0
"""Largest slope of depth across a hole in one surface (72 degrees); the step behind a nearer object is steeper."""
_CREASE = 0.17
"""Two surfaces meet in a crease where their normals lean towards each other by more than 10 degrees, in radians."""
_RIM = 0.05
"""Share of its rim along which a piece must face another across holes. With this and `_CREASE` halved and doubled,
success and detection of single frames are the same, within 0.008, on OSD, HOTS, clutter and a room."""
_WINDOW = 5
"""Normals at a hole are means over a square of this many pixels a side: depth is worst at the hole's rim."""


@dataclass(frozen=True, slots=True)
class _Meetings:
    """Pairs of regions that meet across holes. regions: (m, 2) labels, lower first; pair: (n,) each link's row of
    `regions`; pixels: (n, 2) flat indices of the pixels that face each other, in the order of `regions`."""

    regions: NDArray[np.int64]
    pair: NDArray[np.int64]
    pixels: NDArray[np.int64]


def join_torn(
    labels: NDArray[np.int32],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    least: int,
    noise: DepthNoise = KINECT_V1,
) -> NDArray[np.int32]:
    """The labels after joining regions of one surface that a hole in depth divides.

    labels: (h, w) int32 from 0, -1 = no object; points, normals: (h, w, 3) float32, camera frame, z = 0 invalid;
    least: regions of fewer pixels have no reliable normal and join any region that they meet.
    """
    count = int(labels.max(initial=-1)) + 1
    met = _meetings(labels, points, noise)
    if len(met.regions) == 0:
        return labels
    valid = (points[..., 2] > 0).astype(np.float32)  # points without depth are zero
    facing = _unit(_means(np.asarray(cv2.boxFilter(normals, -1, (_WINDOW, _WINDOW)), np.float32).reshape(-1, 3), met))
    filled = np.maximum(cv2.boxFilter(valid, -1, (_WINDOW, _WINDOW)), 1e-6)
    places = cv2.boxFilter(points, -1, (_WINDOW, _WINDOW)) / filled[..., None]
    place = _means(places.reshape(-1, 3), met)
    offset = _unit((place[:, 1] - place[:, 0])[:, None])[:, 0]
    crease = np.einsum("mk,mk->m", facing[:, 0] - facing[:, 1], offset)
    sizes = np.bincount(labels[labels >= 0], minlength=count)
    small = sizes[met.regions].min(axis=1) < least
    joined = small | ((crease < _CREASE) & (_shares_of_rim(labels, met, count) >= _RIM))
    return united(labels, met.regions[joined], count)


def _meetings(labels: NDArray[np.int32], points: NDArray[np.float32], noise: DepthNoise) -> _Meetings:
    """Links between regions across pixels without depth, each of which belongs to its nearest valid pixel."""
    h, w = labels.shape
    valid = points[..., 2] > 0
    _, nearest = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    source = np.zeros(nearest.max() + 1, np.int64)
    source[nearest[valid]] = np.flatnonzero(valid)
    links, regions = np.empty((4 * h * w, 2), np.int64), np.empty((4 * h * w, 2), np.int64)
    count = _link(labels, source[nearest], np.ascontiguousarray(points), noise.coefficients(), links, regions)
    key, pair = np.unique(regions[:count, 0] << 32 | regions[:count, 1], return_inverse=True)
    return _Meetings(np.stack((key >> 32, key & 0xFFFFFFFF), axis=1), pair.ravel(), links[:count])


@kernel("i8(i4[:,::1], i8[:,::1], f4[:,:,::1], UniTuple(f4, 3), i8[:,::1], i8[:,::1])")
def _link(
    labels: NDArray[np.int32],
    owner: NDArray[np.int64],
    points: NDArray[np.float32],
    noise: tuple[np.float32, np.float32, np.float32],
    links: NDArray[np.int64],
    regions: NDArray[np.int64],
) -> int:
    """Write the links across holes between pixels whose surfaces are near, and their regions; returns their number.

    owner: (h, w), flat index of the valid pixel nearest to each pixel; links, regions: (4 h w, 2) buffers.
    """
    h, w = labels.shape
    near, steep, noises = np.float32(_GAP**2), np.float32(_STEEP), np.float32(3)
    count = 0
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for v in range(h - dv):
            for u in range(max(0, -du), w - max(0, du)):
                i, j = owner[v, u], owner[v + dv, u + du]
                if i == j or (i == v * w + u and j == (v + dv) * w + u + du):
                    continue  # no hole is between the two
                y, x, q, p = i // w, i % w, j // w, j % w
                a, b = labels[y, x], labels[q, p]
                if a < 0 or b < 0 or a == b or max(abs(y - q), abs(x - p)) <= 1:
                    continue
                right, down = points[y, x, 0] - points[q, p, 0], points[y, x, 1] - points[q, p, 1]
                deep = abs(points[y, x, 2] - points[q, p, 2])
                square = right * right + down * down + deep * deep
                aside = np.sqrt(max(square - deep * deep, np.float32(0)))
                if square < near and deep < steep * aside + noises * axial_noise_kernel(points[y, x, 2], noise):
                    if a > b:
                        a, b, i, j = b, a, j, i
                    links[count, 0], links[count, 1] = i, j
                    regions[count, 0], regions[count, 1] = a, b
                    count += 1
    return count


def _means(values: NDArray[np.floating], met: _Meetings) -> NDArray[np.float64]:
    """(m, 2, 3): the mean of (pixels, 3) values on either side of each pair of regions."""
    count = np.bincount(met.pair, minlength=len(met.regions))
    sums = [
        [np.bincount(met.pair, values[met.pixels[:, side], axis], len(met.regions)) / count for axis in range(3)]
        for side in range(2)
    ]
    return np.array(sums).transpose(2, 0, 1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def _shares_of_rim(labels: NDArray[np.int32], met: _Meetings, count: int) -> NDArray[np.float64]:
    """(m,) share of a region's rim that faces the other one of the pair: the larger share of both."""
    padded = np.pad(labels, 1, constant_values=-1)
    rim = np.zeros(labels.shape, np.bool_)
    for v, u in ((0, 1), (2, 1), (1, 0), (1, 2)):
        rim |= padded[v : v + labels.shape[0], u : u + labels.shape[1]] != labels
    length = np.maximum(np.bincount(labels[rim & (labels >= 0)], minlength=count), 1)
    shares = []
    for side in range(2):
        facing = np.unique(met.pair * labels.size + met.pixels[:, side]) // labels.size
        shares.append(np.bincount(facing, minlength=len(met.regions)) / length[met.regions[:, side]])
    return np.maximum(*shares)
