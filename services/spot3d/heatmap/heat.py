"""The weighted 2D heatmap: how likely each pixel shows an object (paper, Sec. III)."""

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.heatmap.filters import FilteredProposals, filter_proposals
from spot3d.heatmap.pyramid import TILE, DepthTiles, depth_tiles
from spot3d.heatmap.settings import HeatmapSettings


@dataclass(frozen=True, slots=True)
class Heat:
    """The heatmap stage's result for one frame.

    heat: (h, w) uint8, H_2D in 255ths of the frame's maximum.
    accepted, masked, rejected: how many proposals were taken whole, in part, not at all.
    """

    heat: NDArray[np.uint8]
    accepted: int
    masked: int
    rejected: int


def weighted_heat(
    depth: NDArray[np.float32],
    camera: Intrinsics,
    boxes: NDArray[np.float32],
    settings: HeatmapSettings,
) -> Heat:
    """Filter the proposals by depth and sum what is left of them (paper, Eqs. 2-5).

    depth: (h, w) float32 metres, 0 = invalid. boxes: (M, 5) float32 [x, y, w, h, c] pixels.
    Heat is normalised by the frame's maximum, so that the threshold eps means the same in every frame.
    Raises ValueError when a shape is wrong or a box is not finite.
    """
    if depth.shape != camera.shape:
        raise ValueError(f"depth is {depth.shape}, but the intrinsics are for {camera.shape}")
    boxes = np.ascontiguousarray(boxes, dtype=np.float32).reshape(-1, 5)
    if not np.isfinite(boxes).all():
        raise ValueError("proposals hold values that are not finite")
    tiles = depth_tiles(depth)
    proposals = filter_proposals(boxes, tiles, camera, settings)
    total = sum_proposals(proposals, tiles)
    peak = float(total.max(initial=0.0))
    scale = np.float32(255 / peak if peak > 0 else 0)
    heat = np.rint(total * scale).astype(np.uint8)
    return Heat(heat, proposals.accepted, proposals.masked, proposals.rejected)


def sum_proposals(proposals: FilteredProposals, tiles: DepthTiles) -> NDArray[np.float32]:
    """H_2D: the sum of the proposals' confidences at each pixel that they keep (paper, Eq. 5).

    Returns (h, w) float32. Without any soft cut it is the baseline heatmap (Eqs. 1-2).
    """
    keep = proposals.confidence > 0
    heat: NDArray[np.float32] = _sum_windows(
        proposals.windows[keep],
        proposals.confidence[keep],
        proposals.cut[keep],
        tiles.depth,
        tiles.near,
        tiles.far,
        tiles.whole,
    )
    return heat


@nb.njit(
    "f4[:,::1](i4[:,::1], f4[::1], f4[::1], f4[:,::1], f4[:,::1], f4[:,::1], b1[:,::1])",
    cache=True,
    nogil=True,
)
def _sum_windows(
    windows: NDArray[np.int32],
    confidence: NDArray[np.float32],
    cut: NDArray[np.float32],
    depth: NDArray[np.float32],
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    whole: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """Add every window, then take back what lies beyond its cut (invalid depth, 0, is kept: Eq. 3).

    Windows go into the corners of a difference image, integrated once at the end; a tile wholly inside a
    window and wholly beyond its cut goes into `beyond`; pixels are visited only where a window's rim or its
    cut runs through a tile.
    """
    h, w = depth.shape
    corners = np.zeros((h + 1, w + 1), np.float64)
    beyond = np.zeros(near.shape, np.float64)
    masked = np.zeros((h, w), np.float32)
    for j in range(len(windows)):
        u0, v0, u1, v1 = windows[j]
        limit, c = cut[j], confidence[j]
        corners[v0, u0] += c
        corners[v1, u0] -= c
        corners[v0, u1] -= c
        corners[v1, u1] += c
        if limit == np.inf:
            continue
        for tile_v in range(v0 // TILE, (v1 + TILE - 1) // TILE):
            top, bottom = max(v0, tile_v * TILE), min(v1, tile_v * TILE + TILE)
            for tile_u in range(u0 // TILE, (u1 + TILE - 1) // TILE):
                if far[tile_v, tile_u] <= limit:
                    continue
                left, right = max(u0, tile_u * TILE), min(u1, tile_u * TILE + TILE)
                inside = right - left == TILE and bottom - top == TILE
                if inside and whole[tile_v, tile_u] and near[tile_v, tile_u] > limit:
                    beyond[tile_v, tile_u] += c
                    continue
                for v in range(top, bottom):
                    for u in range(left, right):
                        masked[v, u] += c if depth[v, u] > limit else np.float32(0)
    total = np.empty((h, w), np.float32)
    for v in range(h):
        row = 0.0
        for u in range(w):
            row += corners[v, u]
            if v > 0:
                corners[v, u] = row + corners[v - 1, u]
            else:
                corners[v, u] = row
            total[v, u] = max(0.0, corners[v, u] - masked[v, u] - beyond[v // TILE, u // TILE])
    return total
