"""Flying pixels: depth between two surfaces, at pixels that see the edge of one and what is behind it.

Time-of-flight cameras mix both depths; stereo, smoothing and resizing bridge them. Veils of such pixels hang from all
outlines, join separate objects and make boxes too large.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part

_FLANK = np.float32(np.tan(np.radians(70)))
"""Depth that changes over a few pixels like that of a surface seen at more than 70 degrees is an edge. Detection with
60, 65, 68, 70 degrees in two cluttered scenes: 0.85, 0.87, 0.91, 0.91 if depth is a mean over 1 pixel to each side
(0.73 if nothing is moved), 0.60, 0.64, 0.64, 0.62 over 2 (0.30)."""
_WIDTH = 6
"""Largest width of a flank, steps: that of a mean over two pixels to each side. With 8, objects as narrow begin to be
lost: detection 0.83 and 0.60 (scenes as above, 65 degrees)."""
_EDGE = np.float32(0.04)
"""An edge is where depth rises by this share of it: 4 cm at 1 m, several times its noise."""
_SHARP = 0.8
"""An edge is sharp if one step is this share of it. Sharp edges of a frame (medians): 69 to 100 % in four real data
sets of Kinects, 49 % or more with twice the noise, 2 to 32 % where depth is mixed over a pixel or more."""


def without_flying(depth: NDArray[np.float32], focal: float, grazing_cos: float) -> NDArray[np.float32]:
    """Depth without flying pixels: those between two opposite neighbours, steeper to both than a surface seen at
    `grazing_cos`. If most edges are mixed, pixels between two surfaces are moved to the one nearer to them before.

    depth: (h, w) float32 metres, 0 = invalid, of a lattice of about 320 pixels across; focal: its, pixels.
    """
    slope = _FLANK / np.float32(focal)
    sharp, edges = _count_edges(depth, slope)
    if 2 * sharp < edges:
        moved = depth.copy()
        _move(depth, slope, moved)
        depth = moved
    clear = depth.copy()
    _leave_out(depth, np.float32(np.sqrt(1 / grazing_cos**2 - 1) / focal), clear)
    return clear


@part()
def _between(before: np.float32, here: np.float32, after: np.float32, step: np.float32) -> bool:
    """Whether depth rises, or falls, by more than `step` from each of three pixels in a row to the next."""
    rise, further = here - before, after - here
    valid = (before > 0) & (after > 0)
    return bool(valid & (((rise > step) & (further > step)) | ((rise < -step) & (further < -step))))


@part()
def _foot(depth: NDArray[np.float32], at: tuple[int, int], towards: tuple[int, int], slope: np.float32) -> int:
    """Steps from a pixel of a flank to its foot: at a hole, or where depth changes less steeply or turns."""
    h, w = depth.shape
    y, x = at[0] + towards[0], at[1] + towards[1]
    here, after = depth[at], depth[y, x]
    sign = np.float32(1) if after > here else np.float32(-1)
    steps = 0
    while after > 0 and sign * (after - here) > slope * here and steps <= _WIDTH:
        steps += 1
        y, x, here = y + towards[0], x + towards[1], after
        after = depth[y, x] if 0 <= y < h and 0 <= x < w else np.float32(0)
    return steps


@kernel("UniTuple(i8, 2)(f4[:,::1], f4)")
def _count_edges(depth: NDArray[np.float32], slope: np.float32) -> tuple[int, int]:
    """The numbers of sharp edges and of all edges in rows and columns of pixels. slope: as in `_move`."""
    sharp, edges = 0, 0
    h, w = depth.shape
    for y, x in ((0, 1), (1, 0)):
        for v in range(y, h - y):
            for u in range(x, w - x):
                first, second, steep = depth[v, u], depth[v + y, u + x], slope * depth[v, u]
                if first <= 0 or second <= 0 or abs(second - first) <= steep:
                    continue
                if _between(depth[v - y, u - x], first, second, steep):
                    continue  # the flank begins before
                steps = _foot(depth, (v, u), (y, x), slope)
                rise = abs(depth[v + steps * y, u + steps * x] - first)
                if steps <= _WIDTH and rise > _EDGE * first:
                    largest = np.float32(0)
                    for k in range(steps):
                        a, b = depth[v + k * y, u + k * x], depth[v + (k + 1) * y, u + (k + 1) * x]
                        largest = max(largest, abs(b - a))
                    edges += 1
                    sharp += largest > _SHARP * rise
    return sharp, edges


@kernel("void(f4[:,::1], f4, f4[:,::1])")
def _move(depth: NDArray[np.float32], slope: np.float32, moved: NDArray[np.float32]) -> None:
    """Give pixels on a flank the depth of its nearer foot. slope: change of depth per pixel, as a share of depth.

    If a pixel is on flanks in several of four directions, the one with the largest step decides.
    """
    diagonal = slope * np.float32(np.sqrt(2))
    h, w = depth.shape
    for v in range(1, h - 1):
        for u in range(1, w - 1):
            z, largest = depth[v, u], np.float32(0)
            for y, x in ((0, 1), (1, 0), (1, 1), (1, -1)):
                steep = diagonal if y * x else slope
                if not _between(depth[v - y, u - x], z, depth[v + y, u + x], steep * z):
                    continue
                back, ahead = _foot(depth, (v, u), (-y, -x), steep), _foot(depth, (v, u), (y, x), steep)
                one, other = depth[v - back * y, u - back * x], depth[v + ahead * y, u + ahead * x]
                if back + ahead <= _WIDTH and abs(other - one) > largest:
                    largest = abs(other - one)
                    moved[v, u] = one if abs(z - one) < abs(other - z) else other


@kernel("void(f4[:,::1], f4, f4[:,::1])")
def _leave_out(depth: NDArray[np.float32], slope: np.float32, clear: NDArray[np.float32]) -> None:
    """Copy depth to `clear`, with 0 at pixels between two surfaces. slope: as in `_move`."""
    diagonal = slope * np.float32(np.sqrt(2))
    h, w = depth.shape
    for v in range(h):
        above, row, below = depth[max(v - 1, 0)], depth[v], depth[min(v + 1, h - 1)]
        # Left, own and right columns of all pixels, so that several are computed at once.
        a0, a1, a2 = above[:-2], above[1:-1], above[2:]
        r0, r1, r2 = row[:-2], row[1:-1], row[2:]
        b0, b1, b2 = below[:-2], below[1:-1], below[2:]
        to = clear[v, 1:-1]
        for u in range(w - 2):
            z = r1[u]
            level, slant = slope * z, diagonal * z
            flies = _between(r0[u], z, r2[u], level) | _between(a1[u], z, b1[u], level)
            flies |= _between(a0[u], z, b2[u], slant) | _between(a2[u], z, b0[u], slant)
            to[u] = np.float32(0) if flies else z
