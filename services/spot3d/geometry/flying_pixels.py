"""Depth between two surfaces, where there is none: a pixel that sees the edge of one and what is behind it.

Time-of-flight cameras mix both, stereo and whoever smooths or resizes depth bridge them: veils hang from all outlines,
join what is apart and make boxes too large.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part


def without_flying(depth: NDArray[np.float32], focal: float, grazing_cos: float) -> NDArray[np.float32]:
    """Depth without pixels that lie between their neighbours of two sides, steeply to both.

    depth: (h, w) float32 metres, 0 = invalid; focal: pixels; grazing_cos: of the surface that would be as steep.
    """
    clear = depth.copy()
    _leave_out(depth, np.float32(np.sqrt(1 / grazing_cos**2 - 1) / focal), clear)
    return clear


@part()
def _between(before: np.float32, here: np.float32, after: np.float32, step: np.float32) -> bool:
    """Whether depth rises, or falls, by more than `step` from each of three pixels in a row to the next."""
    rise, further = here - before, after - here
    valid = (before > 0) & (after > 0)
    return bool(valid & (((rise > step) & (further > step)) | ((rise < -step) & (further < -step))))


@kernel("void(f4[:,::1], f4, f4[:,::1])")
def _leave_out(depth: NDArray[np.float32], slope: np.float32, clear: NDArray[np.float32]) -> None:
    """Clear the pixels between two surfaces. slope: depth's change from pixel to pixel, as a share of it."""
    diagonal = slope * np.float32(np.sqrt(2))
    h, w = depth.shape
    for v in range(h):
        above, row, below = depth[max(v - 1, 0)], depth[v], depth[min(v + 1, h - 1)]
        # Of the pixels' left, own and right columns, so that several pixels are looked at at once.
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
