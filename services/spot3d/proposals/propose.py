"""The proposals stage's core: a registered RGB-D frame becomes M generic boxes."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.proposals.edges import EdgeMap, detect_edges
from spot3d.proposals.groups import group_edges
from spot3d.proposals.metric_size import DepthRange, depth_range
from spot3d.proposals.nms import suppress
from spot3d.proposals.settings import ProposalSettings
from spot3d.proposals.window_index import index_windows
from spot3d.proposals.windows import refine, search, window_shapes

# EdgeBoxes' own values: the exponent of a window's size that its score is divided by; the largest ratio of its sides;
# and the score below which it is no proposal.
_KAPPA, _ASPECT_MAX, _SCORE_MIN = 1.5, 3.0, 0.01
_POOL = 1000
"""If fewer boxes are asked for, they are chosen from this many: the paper's M."""


def propose(
    colour: NDArray[np.uint8], depth_m: NDArray[np.float32], intrinsics: Intrinsics, settings: ProposalSettings
) -> NDArray[np.float32]:
    """Boxes that are likely to hold an object (paper, Sec. III, Eq. 1; Zitnick and Dollar, ECCV 2014).

    colour: (h, w, 3) uint8 RGB, registered with depth_m: (h, w) float32 metres, 0 = invalid. Returns (M, 5)
    float32 [x, y, w, h, c], pixels x..x + w - 1 and y..y + h - 1; c is EdgeBoxes' score. First come those that lie
    apart (`settings.apart`), best first, then the others, best first. M is at most `settings.max_boxes`, 0 for a
    picture without edges. Raises ValueError for wrong shapes or dtypes and for depth that is negative or not finite.
    """
    if colour.shape != (*intrinsics.shape, 3) or colour.dtype != np.uint8:
        raise ValueError(f"colour is {colour.dtype} {colour.shape}; expected uint8 {(*intrinsics.shape, 3)}")
    if depth_m.shape != intrinsics.shape or depth_m.dtype != np.float32:
        raise ValueError(f"depth is {depth_m.dtype} {depth_m.shape}; expected float32 {intrinsics.shape}")
    if not 0 <= depth_m.min() <= depth_m.max() < np.inf:
        raise ValueError("depth must be finite and not negative; 0 marks invalid pixels")
    colour, depth_m, camera, factor = _reduced(colour, depth_m, intrinsics, settings.search_width)
    edges = detect_edges(colour, depth_m, camera.fx, settings.edges, camera.noise)
    boxes = boxes_from_edges(edges, metric_limits(depth_m, camera, settings), settings)
    boxes[:, :4] *= factor
    return boxes


def _reduced(
    colour: NDArray[np.uint8], depth: NDArray[np.float32], camera: Intrinsics, width: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32], Intrinsics, int]:
    """The frame at the whole fraction of its size that comes nearest to `width`, and that factor.

    Colour is averaged over blocks; depth is each block's first pixel: an average would float between surfaces.
    """
    factor = max(1, min(round(camera.width / width), camera.height))  # a wide, low image keeps a row
    w, h = camera.width // factor, camera.height // factor
    small = replace(camera.thinned(factor), width=w, height=h)
    if factor > 1:
        whole = colour[: h * factor, : w * factor]
        colour = cv2.resize(whole, (w, h), interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        depth = depth[: h * factor : factor, : w * factor : factor]
    return np.ascontiguousarray(colour), np.ascontiguousarray(depth), small, factor


def metric_limits(depth: NDArray[np.float32], intrinsics: Intrinsics, settings: ProposalSettings) -> DepthRange:
    """Depth ranges for culling windows by metric size; all windows pass without depth or with culling off."""
    wanted = settings.metric_culling and bool(depth.any())
    return depth_range(depth, intrinsics.fx if wanted else 0, intrinsics.fy, settings.size_min, settings.size_max)


def boxes_from_edges(edges: EdgeMap, ranges: DepthRange, settings: ProposalSettings) -> NDArray[np.float32]:
    """EdgeBoxes on a thin edge map: groups, search, refinement, suppression. Returns `propose`'s boxes."""
    height, width = edges.magnitude.shape
    groups = group_edges(*edges, settings.cluster_min_magnitude, settings.gamma)
    index = index_windows(edges.magnitude, groups, _KAPPA)
    min_area = settings.min_box_area * (width * height / (640 * 480) if settings.scaled_area else 1.0)
    shapes = window_shapes(width, height, settings.alpha, _ASPECT_MAX, min_area)
    windows, scores = search(index, ranges, shapes, _SCORE_MIN)
    place_step = (1 - settings.alpha) / (1 + settings.alpha)
    best = np.argsort(-scores, kind="stable")[: settings.refined]
    refined, better = windows[best], scores[best]
    refine(index, refined, better, np.float32(place_step), settings.finest)
    windows[best], scores[best] = refined, better
    order = np.argsort(-scores, kind="stable")
    kept = suppress(windows, order, settings.beta, max(settings.max_boxes, _POOL))
    first = suppress(windows, kept, settings.apart, kept.size)
    kept = np.concatenate((first, kept[~np.isin(kept, first)]))[: settings.max_boxes]
    low, high = np.hsplit(windows[kept], 2)
    return np.column_stack((low, high - low, scores[kept])).astype(np.float32)
