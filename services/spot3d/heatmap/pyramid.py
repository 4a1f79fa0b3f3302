"""Minimum and maximum depth of image tiles: ranges of windows without reading every pixel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

TILE = 8
"""Side of a tile in pixels."""

ORDERED = {"nnan", "nsz"}
"""What numba may assume of depths: none is nan, so that minima run over several values at once."""


@dataclass(frozen=True, slots=True)
class DepthTiles:
    """A depth image in tiles of TILE x TILE pixels, each with its depth range.

    pixels: (ceil(h / TILE), ceil(w / TILE), TILE * TILE) float32 metres, 0 = invalid or beyond the image; each
    tile's pixels lie together, row by row.
    near, far: (ceil(h / TILE), ceil(w / TILE)) float32, over valid pixels; inf and 0 where there is none.
    whole: the same shape, bool, true where no pixel of the tile is invalid.
    """

    pixels: NDArray[np.float32]
    near: NDArray[np.float32]
    far: NDArray[np.float32]
    whole: NDArray[np.bool_]


def depth_tiles(depth: NDArray[np.float32]) -> DepthTiles:
    """Tile minima and maxima of a (h, w) float32 depth image in metres, 0 = invalid."""
    h, w = depth.shape
    shape = ((h + TILE - 1) // TILE, (w + TILE - 1) // TILE)
    tiles = DepthTiles(
        np.zeros((*shape, TILE * TILE), np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.bool_),
    )
    _tile_ranges(np.ascontiguousarray(depth, dtype=np.float32), tiles.pixels, tiles.near, tiles.far, tiles.whole)
    return tiles


@kernel("void(f4[:,::1], f4[:,:,::1], f4[:,::1], f4[:,::1], b1[:,::1])", fastmath=ORDERED)
def _tile_ranges(
    depth: NDArray[np.float32],
    pixels: NDArray[np.float32],
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    whole: NDArray[np.bool_],
) -> None:
    """Fill in the fields of DepthTiles; `pixels` is 0."""
    h, w = depth.shape
    for v in range(h):
        row = (v % TILE) * TILE
        for tile in range(w // TILE):
            for u in range(TILE):
                pixels[v // TILE, tile, row + u] = depth[v, tile * TILE + u]
        for u in range(w // TILE * TILE, w):
            pixels[v // TILE, w // TILE, row + u % TILE] = depth[v, u]
    none = np.float32(np.inf)
    for tile_v in range(near.shape[0]):
        for tile_u in range(near.shape[1]):
            lo, hi, least = none, np.float32(0), none
            for i in range(TILE * TILE):
                z = pixels[tile_v, tile_u, i]
                valid = z if z > 0 else none
                least = z if z < least else least
                lo = valid if valid < lo else lo
                hi = z if z > hi else hi
            near[tile_v, tile_u], far[tile_v, tile_u] = lo, hi
            whole[tile_v, tile_u] = least > 0
