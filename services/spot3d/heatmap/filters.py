"""Soft and hard filtering: what each proposal keeps of its box, by its depth (paper, Sec. IV-B, IV-C)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.heatmap.pyramid import ORDERED, TILE, DepthTiles
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.kernel import kernel


@dataclass(frozen=True, slots=True)
class FilteredProposals:
    """Proposals with the verdict of both filters.

    windows: (M, 4) int32 pixel ranges [u0, v0, u1, v1), clipped to the image.
    confidence: (M,) float32, c^j; 0 where the hard filter rejects (delta_h^j = 0).
    cut: (M,) float32 metres, the depth Z_mu^j beyond which the soft filter masks; +inf where it masks nothing.
    """

    windows: NDArray[np.int32]
    confidence: NDArray[np.float32]
    cut: NDArray[np.float32]


def filter_proposals(
    boxes: NDArray[np.float32], tiles: DepthTiles, camera: Intrinsics, settings: HeatmapSettings
) -> FilteredProposals:
    """Judge every proposal by the depth inside it (paper, Eqs. 4 and 5).

    boxes: (M, 5) float32 [x, y, w, h, c] pixels. A pixel belongs to a box when x <= u < x + w (rounded).
    A box without any valid depth is rejected, whichever filters are on.
    """
    corners = np.concatenate((boxes[:, :2], boxes[:, :2] + boxes[:, 2:4]), axis=1)
    limits = camera.width, camera.height, camera.width, camera.height
    windows = np.clip(np.rint(corners), 0, limits).astype(np.int32)
    near, far, size_depth = np.empty((3, len(windows)), np.float32)
    _depth_ranges(windows, tiles.pixels, tiles.near, tiles.far, near, far)
    middle = (near + far) / 2
    masks = (far - near > settings.depth_range_min) & settings.soft_filter
    cut = np.where(masks, middle, np.inf).astype(np.float32)
    if settings.size_depth == "foreground":
        _mean_depths(windows, tiles.pixels, cut, size_depth)
    else:
        size_depth[:] = middle
    width_m = boxes[:, 2] * size_depth / np.float32(camera.fx)
    height_m = boxes[:, 3] * size_depth / np.float32(camera.fy)
    rejected = ~np.isfinite(near) | ~(boxes[:, 4] > 0)
    if settings.hard_filter:
        rejected |= (width_m < settings.size_min) & (height_m < settings.size_min)
        rejected |= (width_m > settings.size_max) & (height_m > settings.size_max)
    return FilteredProposals(windows, np.where(rejected, 0, boxes[:, 4]).astype(np.float32), cut)


@kernel("void(i4[:,::1], f4[:,:,::1], f4[:,::1], f4[:,::1], f4[::1], f4[::1])", fastmath=ORDERED)
def _depth_ranges(
    windows: NDArray[np.int32],
    pixels: NDArray[np.float32],
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    smallest: NDArray[np.float32],
    largest: NDArray[np.float32],
) -> None:
    """Smallest and largest valid depth of every window; (inf, 0) where it has none.

    Tiles wholly inside are read first, so that most tiles on the rim can add nothing and are skipped.
    """
    none = np.float32(np.inf)
    for j in range(len(windows)):
        u0, v0, u1, v1 = windows[j, 0], windows[j, 1], windows[j, 2], windows[j, 3]
        lo, hi = none, np.float32(0)
        first_inside, end_inside = (v0 + TILE - 1) // TILE, v1 // TILE
        for tile_v in range(first_inside, end_inside):
            for tile_u in range((u0 + TILE - 1) // TILE, u1 // TILE):
                lo = near[tile_v, tile_u] if near[tile_v, tile_u] < lo else lo
                hi = far[tile_v, tile_u] if far[tile_v, tile_u] > hi else hi
        last = (u1 + TILE - 1) // TILE - 1
        for tile_v in range(v0 // TILE, (v1 + TILE - 1) // TILE):
            # Of rows wholly inside, only the first and the last tile can be on the rim.
            step = max(1, last - u0 // TILE) if first_inside <= tile_v < end_inside else 1
            for tile_u in range(u0 // TILE, last + 1, step):
                if near[tile_v, tile_u] >= lo and far[tile_v, tile_u] <= hi:
                    continue
                top, bottom = v0 - tile_v * TILE, v1 - tile_v * TILE
                left, right = u0 - tile_u * TILE, u1 - tile_u * TILE
                tile = pixels[tile_v, tile_u]
                for i in range(TILE * TILE):
                    v, u = i // TILE, i % TILE
                    inside = (v >= top) & (v < bottom) & (u >= left) & (u < right)
                    z = tile[i] if inside else np.float32(0)
                    hi = z if z > hi else hi
                    z = z if z > 0 else none
                    lo = z if z < lo else lo
        smallest[j], largest[j] = lo, hi


@kernel("void(i4[:,::1], f4[:,:,::1], f4[::1], f4[::1])")
def _mean_depths(
    windows: NDArray[np.int32], pixels: NDArray[np.float32], cut: NDArray[np.float32], mean: NDArray[np.float32]
) -> None:
    """Mean of every window's valid depths that are no farther than its cut; 0 where there are none."""
    for j in range(len(windows)):
        u0, v0, u1, v1 = windows[j, 0], windows[j, 1], windows[j, 2], windows[j, 3]
        total, count = np.float64(0), 0
        for tile_v in range(v0 // TILE, (v1 + TILE - 1) // TILE):
            top, bottom = v0 - tile_v * TILE, v1 - tile_v * TILE
            for tile_u in range(u0 // TILE, (u1 + TILE - 1) // TILE):
                left, right = u0 - tile_u * TILE, u1 - tile_u * TILE
                tile = pixels[tile_v, tile_u]
                for i in range(TILE * TILE):
                    v, u = i // TILE, i % TILE
                    inside = (v >= top) & (v < bottom) & (u >= left) & (u < right)
                    taken = inside & (tile[i] > 0) & (tile[i] <= cut[j])
                    total += np.float64(tile[i]) if taken else np.float64(0)
                    count += 1 if taken else 0
        mean[j] = total / max(count, 1)
