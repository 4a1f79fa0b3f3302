"""Split the foreground at concave creases: where two objects touch, or one stands on another.

Real objects are mostly convex, and the seam between two that touch is concave (Stein et al., *Convexity based object
partitioning for robot applications*, ICRA 2014). Lengths here are shares of the range, so that an object is split alike
from near and from far: pixels and the noise of depth grow with the range. A camera with fewer pixels per radian
sees blunter creases, because normals come from neighbouring pixels.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.segments.nearness import apart, within
from spot3d.segments.seams import join_at_seams

_NEAR = np.float32(0.01)
"""Pixels within this share of the range count for each other's curvature: 1 cm at 1 m, several times the noise."""
_LINK = np.float32(0.008)
"""Neighbouring pixels within this share of the range lie on one surface."""
_ALONG, _LEVEL = np.float32(0.025), np.float32(0.2)
"""Adjacent pixels within this share lie on one surface, too, if they are in each other's tangent planes to 12 degrees:
seen at 8 degrees the pixels of a surface are this far apart on a lattice of 320 across."""
_LIKE = np.float32(0.9)
"""Normals within this cosine (26 degrees) are averaged."""
_CONVEX = np.float32(-20.0)
"""A pair counts as no more convex than this, so that a convex edge does not hide the crease that it meets."""
_FAINT = 0.7
"""Pixels with this share of a crease's concavity separate regions, and the mean concavity along a seam decides whether
to join them again. Otherwise a gap of one pixel in a crease, left by noise, would join two objects. With 1, 0.8, 0.7,
0.6, 0.5: detection 0.873, 0.878, 0.884, 0.884, 0.885, success 0.826, 0.826, 0.826, 0.824, 0.823 (single frames of four
cluttered scenes not used for tuning); OSD is the same with all of them, HOTS to one object in 288."""
_SHARP = 3.0
"""A crease this many times as concave separates regions of one colour, too: boxes that touch at a right angle. Whole
with 2, 2.5, 3, 4, of 4100 views of objects on ten rendered desks: 79.6, 80.0, 80.2, 80.3 %, and 79.2 % without colour.
From 4 on such boxes become one."""
_AREA = 1.5e-3
"""A region of this area, square metres, is large enough from any distance: objects that stand on another are small, and
a cube of 4 cm shows as much. Without it, with 20, 15 and 10 cm2 a puzzle cube on a book 1.5 to 2.5 m away is a segment
of its own in 0.24, 0.56, 0.56 and 0.56 of the views of five desks, and 0.717, 0.744, 0.741 and 0.741 of all views of
objects there have an IoU of 0.5. With 15 cm2 that rises by 0.010 in rooms, 0.006 on bookcases and changing tables,
0.003 in clutter and 0.001 in bins, and falls by 0.001 on near desks. Single frames of HOTS have a success of 0.92, as
without it."""
_GAP = np.ones((3, 3), np.uint8)
"""Regions that only gaps of two pixels in a crease join are separate at first: where a convex edge ends on a crease, as
the upright edges of a box on a box, it hides the crease. With no gap closed, two, four and six pixels: success and
detection on HOTS 0.935, 0.948; 0.939, 0.951; 0.932, 0.951; 0.910, 0.944; OSD the same but for the last. In 29 rendered
scenes of seven kinds 0.885, 0.896 without and 0.879, 0.913 with two (stacks are parted, but a laptop's halves as well),
with 0.2 boxes of no object a scene more; in 16 of them, not used for tuning, 0.900, 0.907; 0.914, 0.937; with four
0.883, 0.916."""
_ROUNDS = 12
"""Rounds in which pixels of a crease join the regions beside it, by two pixels each."""


def split_at_creases(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    mask: NDArray[np.bool_],
    colour: NDArray[np.uint8] | None,
    focal: float,
    crease: float,
    least: int,
) -> NDArray[np.int32]:
    """Regions of the pixels in `mask`, split at creases, however faint, and with gaps.

    The creases' pixels join the nearest region. Then regions are joined whose seam as a whole is no crease, or no sharp
    one if they have one colour.

    points, normals: (h, w, 3) float32, camera frame, metres and unit (zero = unknown); mask: (h, w) bool, of valid
    pixels; colour: (h, w, 3) uint8 RGB, None = ignored; focal: pixels; crease: concavity, as the range times the
    mean curvature, from which a pixel is a crease; least: pixels of smaller regions join another as those of creases,
    unless they have `_AREA`.
    Returns (h, w) int32: regions from 0, -1 = not in `mask`. Pixels near no region form regions of their own.
    """
    reach = max(1, int(_NEAR * focal))
    smooth = normals.copy()
    _smooth(points, normals, mask, reach, smooth)
    bend, count = np.zeros(mask.shape, np.float32), np.full(mask.shape, 1e-6, np.float32)
    _concavity(points, smooth, mask, reach, bend, count)
    off = mask & (bend < _FAINT * crease)
    labels, cores = np.empty(mask.shape, np.int32), np.empty(mask.shape, np.int32)
    _connect(points, smooth, off, least, _AREA * focal * focal, labels)
    far_off = off & (cv2.dilate((mask & ~off).view(np.uint8), _GAP) == 0)
    _connect(points, smooth, far_off, least, _AREA * focal * focal, cores)
    labels = _divided(labels, cores)
    _share_out(points, mask, labels)
    labels = join_at_seams(labels, points, bend, colour, crease, _SHARP * crease, float(_LINK))
    rest = np.empty(mask.shape, np.int32)
    _connect(points, smooth, mask & (labels < 0), 1, np.inf, rest)
    return np.where(rest >= 0, rest + np.int32(labels.max(initial=-1) + 1), labels)


def _divided(labels: NDArray[np.int32], cores: NDArray[np.int32]) -> NDArray[np.int32]:
    """The regions, but of those that hold several cores only these. Labels from 0 without gaps, -1 = none.

    labels, cores: (h, w) int32, the like; a core lies in one region.
    """
    region = np.empty(int(cores.max(initial=-1)) + 1, np.int32)
    region[cores[cores >= 0]] = labels[cores >= 0]
    several = np.bincount(region, minlength=int(labels.max(initial=-1)) + 1) > 1
    alone, split = ~several, several[region]
    of_region = np.where(alone, np.cumsum(alone) - 1, -1)
    of_core = np.where(split, alone.sum() + np.cumsum(split) - 1, -1)
    # The last entry is for -1, none.
    return np.asarray(np.maximum(np.append(of_region, -1)[labels], np.append(of_core, -1)[cores]), np.int32)


@kernel("void(f4[:,:,::1], f4[:,:,::1], b1[:,::1], i8, f4[:,:,::1])")
def _smooth(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    mask: NDArray[np.bool_],
    reach: int,
    smooth: NDArray[np.float32],
) -> None:
    """The mean of each pixel's normal and similar normals near it: noise falls, creases stay.

    smooth: `normals` at first. Each pair of pixels is visited once, from its first pixel, here and in `_concavity`.
    """
    h, w = mask.shape
    for v in range(h):
        for u in range(w):
            if not mask[v, u]:
                continue
            n0, n1, n2 = normals[v, u, 0], normals[v, u, 1], normals[v, u, 2]
            s0, s1, s2 = smooth[v, u, 0], smooth[v, u, 1], smooth[v, u, 2]
            for y in range(v, min(h, v + reach + 1)):
                for x in range(max(0, u - reach) if y > v else u, min(w, u + reach + 1)):
                    if mask[y, x]:
                        m0, m1, m2 = normals[y, x, 0], normals[y, x, 1], normals[y, x, 2]
                        if n0 * m0 + n1 * m1 + n2 * m2 > _LIKE and within(points, v, u, y, x, _NEAR):
                            s0, s1, s2 = s0 + m0, s1 + m1, s2 + m2
                            smooth[y, x, 0], smooth[y, x, 1] = smooth[y, x, 0] + n0, smooth[y, x, 1] + n1
                            smooth[y, x, 2] += n2
            scale = np.float32(1) / max(np.sqrt(s0 * s0 + s1 * s1 + s2 * s2), np.float32(1e-6))
            smooth[v, u, 0], smooth[v, u, 1], smooth[v, u, 2] = s0 * scale, s1 * scale, s2 * scale


@kernel("void(f4[:,:,::1], f4[:,:,::1], b1[:,::1], i8, f4[:,::1], f4[:,::1])")
def _concavity(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    mask: NDArray[np.bool_],
    reach: int,
    bend: NDArray[np.float32],
    count: NDArray[np.float32],
) -> None:
    """Mean curvature towards the near pixels times the range: positive in a hollow or crease, negative on a ball.

    bend: 0 at first; count: nearly 0 at first, a buffer for the number of near pixels.
    """
    h, w = mask.shape
    for v in range(h):
        for u in range(w):
            if not mask[v, u]:
                continue
            total, pairs = bend[v, u], count[v, u]
            for y in range(v, min(h, v + reach + 1)):
                for x in range(max(0, u - reach) if y > v else u + 1, min(w, u + reach + 1)):
                    if mask[y, x]:
                        a, b = points[y, x, 0] - points[v, u, 0], points[y, x, 1] - points[v, u, 1]
                        c = points[y, x, 2] - points[v, u, 2]
                        square = a * a + b * b + c * c
                        depth = np.float32(0.5) * (points[v, u, 2] + points[y, x, 2])
                        if square < (_NEAR * depth) ** 2:
                            turn = (normals[v, u, 0] - normals[y, x, 0]) * a
                            turn += (normals[v, u, 1] - normals[y, x, 1]) * b
                            turn += (normals[v, u, 2] - normals[y, x, 2]) * c
                            turn = max(turn * depth / square, _CONVEX)
                            total, pairs = total + turn, pairs + np.float32(1)
                            bend[y, x], count[y, x] = bend[y, x] + turn, count[y, x] + np.float32(1)
            bend[v, u] = total / pairs


@part()
def _root(root: NDArray[np.int32], pixel: int) -> int:
    """The root of a pixel's tree; the path to it is halved."""
    while root[pixel] != pixel:
        root[pixel] = root[root[pixel]]
        pixel = root[pixel]
    return pixel


@part()
def _level(points: NDArray[np.float32], normals: NDArray[np.float32], v: int, u: int, y: int, x: int) -> bool:
    """Whether pixel (y, x) lies in the tangent plane of (v, u), if that is known, and not too far along it."""
    a, b, c = points[y, x, 0] - points[v, u, 0], points[y, x, 1] - points[v, u, 1], points[y, x, 2] - points[v, u, 2]
    square, depth = a * a + b * b + c * c, points[v, u, 2]
    off = normals[v, u, 0] * a + normals[v, u, 1] * b + normals[v, u, 2] * c
    near = square < (_ALONG * depth) ** 2
    return bool(near & (off * off < _LEVEL * _LEVEL * square) & (normals[v, u, 2] != 0))


@kernel("void(f4[:,:,::1], f4[:,:,::1], b1[:,::1], i8, f8, i4[:,::1])")
def _connect(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    mask: NDArray[np.bool_],
    least: int,
    large: float,
    labels: NDArray[np.int32],
) -> None:
    """Label connected components of at least `least` pixels from 0 on, all others -1.

    normals: smoothed unit normals, zero = unknown. large: pixels at 1 m of a component that is labelled in any case.
    """
    h, w = mask.shape
    root, size = np.empty(h * w, np.int32), np.zeros(h * w, np.int32)
    for i in range(h * w):
        root[i] = i
    for v in range(h):
        for u in range(w):
            if not mask[v, u]:
                continue
            i = _root(root, v * w + u)
            # Half of the pixels within two of this one: the other half visits the pair.
            for y in range(v, min(h, v + 3)):
                for x in range(max(0, u - 2), min(w, u + 3)):
                    if mask[y, x] and (y > v or x > u):
                        j = _root(root, y * w + x)
                        if i != j and (
                            within(points, v, u, y, x, _LINK)
                            or (
                                max(y - v, abs(x - u)) == 1
                                and _level(points, normals, v, u, y, x)
                                and _level(points, normals, y, x, v, u)
                            )
                        ):
                            i, j = min(i, j), max(i, j)
                            root[j] = i
    depth, inside, label, count = points[:, :, 2], mask.ravel(), labels.ravel(), 0
    for i in range(h * w):
        if inside[i]:
            root[i] = root[root[i]]  # a root precedes its pixels
            size[root[i]] += 1
    for v in range(h):
        for u in range(w):
            i = v * w + u
            label[i] = -1
            if inside[i] and root[i] != i:
                label[i] = label[root[i]]
            elif inside[i] and size[i] >= min(least, large / (depth[v, u] * depth[v, u])):
                label[i] = count
                count += 1


@kernel("void(f4[:,:,::1], b1[:,::1], i4[:,::1])")
def _share_out(points: NDArray[np.float32], mask: NDArray[np.bool_], labels: NDArray[np.int32]) -> None:
    """Give each pixel without a label that of the nearest labelled pixel around it, ring by ring."""
    h, w = mask.shape
    open_v, open_u = np.empty(h * w, np.int32), np.empty(h * w, np.int32)
    found = np.empty(h * w, np.int32)
    count = 0
    for v in range(h):
        for u in range(w):
            if mask[v, u] and labels[v, u] < 0:
                open_v[count], open_u[count] = v, u
                count += 1
    for _ in range(_ROUNDS):
        for k in range(count):
            v, u, best = open_v[k], open_u[k], _LINK * _LINK
            found[k] = -1
            for y in range(max(0, v - 2), min(h, v + 3)):
                for x in range(max(0, u - 2), min(w, u + 3)):
                    if labels[y, x] >= 0:
                        square, range_square = apart(points, v, u, y, x)
                        if square < best * range_square:
                            best, found[k] = square / range_square, labels[y, x]
        left = 0
        for k in range(count):
            if found[k] >= 0:
                labels[open_v[k], open_u[k]] = found[k]
            else:
                open_v[left], open_u[left] = open_v[k], open_u[k]
                left += 1
        if left == count:
            break
        count = left
