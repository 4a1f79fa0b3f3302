"""Search over a grid of window places, sizes and shapes, and refinement of the best (EdgeBoxes, Sec. 3.3)."""

import math

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel
from spot3d.proposals.metric_size import DepthRange, surely_rejected
from spot3d.proposals.scoring import score_limit, score_window
from spot3d.proposals.window_index import WindowIndex

EDGE_BOXES_FINEST = 3  # last move of a window's side in EdgeBoxes, pixels
MIN_SIDE = 4  # of a window, pixels


def window_shapes(
    width: int, height: int, alpha: float, max_aspect_ratio: float, min_box_area: float
) -> NDArray[np.int32]:
    """Widths, heights and steps (n, 4) int32 [w, h, step x, step y] of the search windows, small to large.

    Neighbours in place, size or shape overlap with an IoU of alpha.
    """
    size_step = math.sqrt(1 / alpha)
    shape_step = (1 + alpha) / (2 * alpha)
    place_step = (1 - alpha) / (1 + alpha)
    shapes = int(math.log(max_aspect_ratio) / (2 * math.log(shape_step)))
    least = math.sqrt(min_box_area)
    sizes = max(1, math.ceil(math.log(max(width, height) / least) / math.log(size_step)))
    found = []
    for s in range(sizes):
        for a in range(-shapes, shapes + 1):
            side, stretch = least * size_step**s, shape_step**a
            w, h = int(side * stretch), int(side / stretch)
            if MIN_SIDE <= w <= width and MIN_SIDE <= h <= height:
                found.append((w, h, max(2, int(w * place_step)), max(2, int(h * place_step))))
    return np.array(found, np.int32).reshape(-1, 4)


def search(
    index: WindowIndex, ranges: DepthRange, shapes: NDArray[np.int32], min_score: float
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Windows (n, 4) int32 [x0, y0, x1, y1] of the grid that score above `min_score`, and their scores (n,).

    shapes: (s, 4) int32 of `window_shapes`.
    """
    h, w = index.sums.shape[0] - 1, index.sums.shape[1] - 1
    most = int(((w // shapes[:, 2] + 2) * (h // shapes[:, 3] + 2)).sum())
    windows, scores = np.empty((most, 4), np.int32), np.empty(most, np.float32)
    n = _search(index, ranges, shapes, np.float32(min_score), windows, scores)
    return windows[:n], scores[:n]


@kernel()
def _search(
    index: WindowIndex,
    ranges: DepthRange,
    shapes: NDArray[np.int32],
    min_score: np.float32,
    windows: NDArray[np.int32],
    scores: NDArray[np.float32],
) -> int:
    """Write the windows and their scores; returns their number.

    They are visited place by place, so that neighbours find the tables in the cache.
    """
    h, w = index.sums.shape[0] - 1, index.sums.shape[1] - 1
    n = 0
    for s in range(shapes.shape[0]):
        bw, bh, step_x, step_y = shapes[s, 0], shapes[s, 1], shapes[s, 2], shapes[s, 3]
        for y in range(0, h - bh + step_y, step_y):
            y1 = y + bh if y + bh < h else h
            for x in range(0, w - bw + step_x, step_x):
                x1 = x + bw if x + bw < w else w
                if score_limit(index, x, y, x1, y1) <= min_score or surely_rejected(ranges, x, y, x1, y1):
                    continue
                score = score_window(index, x, y, x1, y1, min_score)
                if score > 0:
                    windows[n, 0], windows[n, 1], windows[n, 2], windows[n, 3] = x, y, x1, y1
                    scores[n] = score
                    n += 1
    return n


@kernel()
def refine(
    index: WindowIndex, windows: NDArray[np.int32], scores: NDArray[np.float32], place_step: np.float32, finest: int
) -> None:
    """Move each window's four sides where that raises its score, by steps that halve down to 1 / `finest` of it.

    windows: (n, 4) int32 [x0, y0, x1, y1]; scores: (n,) float32; place_step: the search's step by side. finest:
    boxes that differ by less than that part of a window mean the same object; 0: steps down to EDGE_BOXES_FINEST.
    """
    h, w = index.sums.shape[0] - 1, index.sums.shape[1] - 1
    for i in range(scores.size):
        box = windows[i]
        step_x, step_y = int((box[2] - box[0]) * place_step) // 2, int((box[3] - box[1]) * place_step) // 2
        last_x, last_y = EDGE_BOXES_FINEST, EDGE_BOXES_FINEST
        if finest > 0:
            last_x, last_y = max(1, (box[2] - box[0]) // finest), max(1, (box[3] - box[1]) // finest)
        while step_x >= last_x or step_y >= last_y:
            for side in (1, 3, 0, 2):
                step = max(1, step_y if side % 2 else step_x)
                outwards = -step if side < 2 else step
                for move in (outwards, -outwards):
                    old = box[side]
                    box[side] = min(max(old + move, 0), h if side % 2 else w)
                    score = np.float32(0)
                    if box[2] - box[0] >= MIN_SIDE and box[3] - box[1] >= MIN_SIDE:
                        x0, y0, x1, y1 = np.int64(box[0]), np.int64(box[1]), np.int64(box[2]), np.int64(box[3])
                        score = score_window(index, x0, y0, x1, y1, scores[i])
                    if score > scores[i]:
                        scores[i] = score
                        break
                    box[side] = old
            step_x, step_y = step_x // 2, step_y // 2
