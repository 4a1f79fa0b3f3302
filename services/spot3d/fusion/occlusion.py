"""Join the parts of one object that something in front of it divides, in a single view."""

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.boxes import upright_box

_AGREE = 0.02
"""Parts of one object agree in their tops, and in the line they stand on, within this many metres."""
_IN_FRONT = 0.02
"""What is this much nearer than the line between two parts hides what is there, metres."""
_HIDDEN = 0.9
"""Share of the pixels between two parts that must be hidden."""


def join_occluded(
    clusters: list[NDArray[np.int64]],
    points: NDArray[np.float32],
    up: NDArray[np.float64],
) -> list[NDArray[np.int64]]:
    """Clusters of pixels of one view, those joined that continue each other behind something nearer.

    clusters: flat pixel numbers; points: (h, w, 3) float32 metres, camera frame, z = 0 invalid; up: (3,) unit, camera
    frame. Two parts continue each other when their tops are level, together they are no thicker than both side by
    side, and all that is seen between them is nearer than both.
    """
    parts = sorted(clusters, key=len, reverse=True)
    flat = points.reshape(-1, 3)
    i = 0
    while i < len(parts):
        partner = next(
            (j for j in range(i + 1, len(parts)) if _continues(parts[i], parts[j], flat, points.shape[1], up)), None
        )
        if partner is None:
            i += 1
        else:
            parts[i] = np.concatenate((parts[i], parts.pop(partner)))
    return parts


def _continues(
    a: NDArray[np.int64], b: NDArray[np.int64], points: NDArray[np.float32], width: int, up: NDArray[np.float64]
) -> bool:
    heights = [np.quantile(points[part] @ up, 0.98) for part in (a, b)]
    if abs(heights[0] - heights[1]) > _AGREE or not _hidden_between(a, b, points, width):
        return False
    thick = [float(np.sort(upright_box(points[part], up, turn=True, trim=0.01).size[:2])[0]) for part in (a, b)]
    union = upright_box(points[np.concatenate((a, b))], up, turn=True, trim=0.01)
    return float(np.sort(union.size[:2])[0]) < sum(thick) + _AGREE


def _hidden_between(a: NDArray[np.int64], b: NDArray[np.int64], points: NDArray[np.float32], width: int) -> bool:
    """Whether the straight line of pixels between the middles of two parts is hidden outside of both."""
    ends = [np.array([np.median(part // width), np.median(part % width)]) for part in (a, b)]
    depths = [float(np.median(points[part, 2])) for part in (a, b)]
    steps = np.linspace(0, 1, int(np.abs(ends[1] - ends[0]).max()) + 2)
    v, u = np.rint(ends[0][:, None] + (ends[1] - ends[0])[:, None] * steps).astype(int)
    line = v * width + u
    between = ~np.isin(line, np.concatenate((a, b)))
    seen = points[line, 2]
    expected = depths[0] + (depths[1] - depths[0]) * steps
    hidden = (seen < expected - _IN_FRONT) & (seen > 0)
    return bool((hidden & between).any()) and float(np.mean((hidden | (seen == 0))[between])) >= _HIDDEN
