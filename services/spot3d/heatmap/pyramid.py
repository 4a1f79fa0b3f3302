"""Minimum and maximum depth of image tiles: ranges of windows without reading every pixel."""

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

TILE = 8
"""Side of a tile in pixels."""


@dataclass(frozen=True, slots=True)
class DepthTiles:
    """A depth image with the depth range of each of its TILE x TILE tiles.

    depth: (h, w) float32 metres, 0 = invalid.
    near, far: (ceil(h / TILE), ceil(w / TILE)) float32, over valid pixels; inf and 0 where there is none.
    whole: the same shape, bool, true where no pixel of the tile is invalid.
    """

    depth: NDArray[np.float32]
    near: NDArray[np.float32]
    far: NDArray[np.float32]
    whole: NDArray[np.bool_]


def depth_tiles(depth: NDArray[np.float32]) -> DepthTiles:
    """Tile minima and maxima of a (h, w) float32 depth image in metres, 0 = invalid."""
    depth = np.ascontiguousarray(depth, dtype=np.float32)
    return DepthTiles(depth, *_tile_ranges(depth))


@nb.njit("Tuple((f4[:,::1], f4[:,::1], b1[:,::1]))(f4[:,::1])", cache=True, nogil=True)
def _tile_ranges(
    depth: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """One pass over the rows; each tile's range over its valid pixels."""
    h, w = depth.shape
    shape = ((h + TILE - 1) // TILE, (w + TILE - 1) // TILE)
    near = np.full(shape, np.inf, np.float32)
    far = np.zeros(shape, np.float32)
    whole = np.ones(shape, np.bool_)
    for v in range(h):
        for tile in range(shape[1]):
            lo, hi, valid = np.float32(np.inf), np.float32(0), True
            for u in range(tile * TILE, min(w, tile * TILE + TILE)):
                z = depth[v, u]
                lo = min(lo, z if z > 0 else np.float32(np.inf))
                hi = max(hi, z)
                valid &= z > 0
            near[v // TILE, tile] = min(near[v // TILE, tile], lo)
            far[v // TILE, tile] = max(far[v // TILE, tile], hi)
            whole[v // TILE, tile] &= valid
    return near, far, whole
