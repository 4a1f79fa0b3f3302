"""Objects as fusion finds them, a run writes them, an evaluation judges them and a picture shows them."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D


@dataclass(frozen=True, slots=True)
class FoundObject:
    """One object in the world frame.

    id: stable number (0 = not yet given); box: upright, metres; confidence: pseudo-average of its segments' heat over
    the keyframes that see it, 0..1; views: keyframes with a segment of it; points: pixels of its segments, summed over
    these keyframes; colour: (3,) float64 mean RGB 0..255, grey if unknown. With the paper's density clustering,
    confidence is the mean of its map points' pseudo-averages, views the largest number of frames that saw one of these
    points, and points their number.
    """

    id: int
    box: Box3D
    confidence: float
    views: int
    points: int
    colour: NDArray[np.float64] = field(default_factory=lambda: np.full(3, 128.0))


@dataclass(frozen=True, slots=True)
class FoundObjects:
    """The objects of one update; up: (3,) unit, world; frame_count: frames fused so far.

    left_out: number of rejected candidates, by reason (see `fusion.objects.reasons`). keyframes_dropped: number of
    keyframes forgotten because there were more than `keyframe_limit`.
    """

    objects: list[FoundObject]
    up: NDArray[np.float64]
    frame_count: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    keyframes_dropped: int = 0
