"""An object as fusion finds it, a run writes it, an evaluation judges it and a picture shows it."""

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
