"""The weighted 2D heatmap: how likely each pixel shows an object (paper, Sec. IV)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.heatmap.filters import FilteredProposals, filter_proposals
from spot3d.heatmap.pyramid import TILE, DepthTiles, depth_tiles
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.kernel import kernel

ALL = 2.0**30
"""Whole number that all confidences of a frame sum up to."""


@dataclass(frozen=True, slots=True)
class Heatmap:
    """The heatmap stage's result for one frame.

    heat: (h, w) uint8, H_2D in 255ths of the frame's maximum.
    accepted, masked, rejected: how many proposals were taken whole, in part, not at all.
    """

    heat: NDArray[np.uint8]
    accepted: int
    masked: int
    rejected: int


def weighted_heat(
    depth: NDArray[np.float32], camera: Intrinsics, boxes: NDArray[np.float32], settings: HeatmapSettings
) -> Heatmap:
    """Filter the proposals by depth and sum what is left of them (paper, Eqs. 3-6).

    depth: (h, w) float32 metres, 0 = invalid. boxes: (M, 5) float32 [x, y, w, h, c] pixels.
    Heat is normalised by the frame's maximum, so that the threshold eps means the same in every frame.
    Raises ValueError when a shape or depth's dtype is wrong or a box is not finite.
    """
    if depth.shape != camera.shape or depth.dtype != np.float32:
        raise ValueError(f"depth is {depth.dtype} {depth.shape}; expected float32 {camera.shape} as of the intrinsics")
    boxes = np.ascontiguousarray(boxes, dtype=np.float32).reshape(-1, 5)
    if not np.isfinite(boxes).all():
        raise ValueError("proposals contain values that are not finite")
    tiles = depth_tiles(depth)
    proposals = filter_proposals(boxes, tiles, camera, settings)
    heat = sum_proposals(proposals, tiles, depth.shape)
    kept, soft = proposals.confidence > 0, np.isfinite(proposals.cut)
    accepted, masked, rejected = (int(np.count_nonzero(which)) for which in (kept & ~soft, kept & soft, ~kept))
    return Heatmap(heat, accepted, masked, rejected)


def sum_proposals(proposals: FilteredProposals, tiles: DepthTiles, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """H_2D: the sum of the proposals' confidences at each pixel that they keep (paper, Eq. 6).

    Returns (h, w) = `shape` uint8, in 255ths of its maximum. Without any soft cut it is the baseline heatmap
    (Eqs. 2-3).
    """
    keep = proposals.confidence > 0
    confidence = proposals.confidence[keep].astype(np.float64)
    # Whole numbers add up exactly: nothing is left over where a box ends. All together they stay below 2^31.
    amount = np.rint(confidence * (ALL / max(float(confidence.sum()), 1e-30))).astype(np.int32)
    windows, cut = proposals.windows[keep], proposals.cut[keep]
    soft = np.isfinite(cut)
    beyond = np.zeros(tiles.near.shape, np.int32)
    masked = _sum_masked(
        windows[soft], amount[soft], cut[soft], tiles.pixels, tiles.near, tiles.far, tiles.whole, beyond
    )
    total, above = np.zeros((shape[0] + 1, shape[1] + 1), np.int32), np.zeros(shape[1], np.int32)
    heat = np.empty(shape, np.uint8)
    _heat_image(windows, amount, masked, beyond, total, above, heat)
    return heat


@kernel("i4[:,:,::1](i4[:,::1], i4[::1], f4[::1], f4[:,:,::1], f4[:,::1], f4[:,::1], b1[:,::1], i4[:,::1])")
def _sum_masked(
    windows: NDArray[np.int32],
    amount: NDArray[np.int32],
    cut: NDArray[np.float32],
    pixels: NDArray[np.float32],
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    whole: NDArray[np.bool_],
    beyond: NDArray[np.int32],
) -> NDArray[np.int32]:
    """The amounts that the soft filter removes at pixels beyond a window's cut (invalid depth, 0, is not: Eq. 4).

    Returns the sums of single pixels, in tiles as `pixels`. Tiles wholly inside a window and wholly beyond its cut are
    added to `beyond`, which is 0: pixels are visited only where a window's rim or its cut runs through a tile.
    """
    masked = np.zeros(pixels.shape, np.int32)  # as an argument, each tile would be checked for overlap with `pixels`
    for j in range(len(windows)):
        u0, v0, u1, v1 = windows[j, 0], windows[j, 1], windows[j, 2], windows[j, 3]
        limit, c = cut[j], amount[j]
        for tile_v in range(v0 // TILE, (v1 + TILE - 1) // TILE):
            top, bottom = v0 - tile_v * TILE, v1 - tile_v * TILE
            for tile_u in range(u0 // TILE, (u1 + TILE - 1) // TILE):
                if far[tile_v, tile_u] <= limit:
                    continue
                left, right = u0 - tile_u * TILE, u1 - tile_u * TILE
                inside = left <= 0 and right >= TILE and top <= 0 and bottom >= TILE
                if inside and whole[tile_v, tile_u] and near[tile_v, tile_u] > limit:
                    beyond[tile_v, tile_u] += c
                    continue
                depth, sums = pixels[tile_v, tile_u], masked[tile_v, tile_u]
                for i in range(TILE * TILE):  # free of branches, so that it runs several pixels at once
                    v, u = i // TILE, i % TILE
                    taken = (depth[i] > limit) & (v >= top) & (v < bottom) & (u >= left) & (u < right)
                    sums[i] += c if taken else np.int32(0)
    return masked


@kernel("void(i4[:,::1], i4[::1], i4[:,:,::1], i4[:,::1], i4[:,::1], i4[::1], u1[:,::1])")
def _heat_image(
    windows: NDArray[np.int32],
    amount: NDArray[np.int32],
    masked: NDArray[np.int32],
    beyond: NDArray[np.int32],
    total: NDArray[np.int32],
    above: NDArray[np.int32],
    heat: NDArray[np.uint8],
) -> None:
    """The sum of all windows less what is masked, in 255ths of the largest sum.

    Windows are added at the corners of a difference image `total`, (h + 1, w + 1), which is integrated once. `above`,
    (w,), holds the sums of the row above. Both are 0 before.
    """
    h, w = heat.shape
    for j in range(len(windows)):
        u0, v0, u1, v1 = windows[j, 0], windows[j, 1], windows[j, 2], windows[j, 3]
        total[v0, u0] += amount[j]
        total[v1, u0] -= amount[j]
        total[v0, u1] -= amount[j]
        total[v1, u1] += amount[j]
    peak = 1
    for v in range(h):
        row = np.int32(0)
        for u in range(w):
            row += total[v, u]
            above[u] += row
        for u in range(w):
            kept = above[u] - masked[v // TILE, u // TILE, v % TILE * TILE + u % TILE] - beyond[v // TILE, u // TILE]
            total[v, u] = kept
            peak = kept if kept > peak else peak
    scale = np.float32(255 / peak)
    for v in range(h):
        for u in range(w):
            heat[v, u] = np.uint8(np.float32(total[v, u]) * scale + np.float32(0.5))
