"""An object as fusion finds it, a run writes it, an evaluation judges it and a picture shows it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D


def _grey() -> NDArray[np.float64]:
    return np.full(3, 128.0)


@dataclass(frozen=True, slots=True)
class FoundObject:
    """One object in the world frame.

    id: stable number (0 = not yet given); box: upright, metres; confidence: mean pseudo-average confidence of
    its points, 0..1; views: frames that saw it; points: map points; colour: (3,) float64 mean RGB 0..255, grey
    where it is not known.
    """

    id: int
    box: Box3D
    confidence: float
    views: int
    points: int
    colour: NDArray[np.float64] = field(default_factory=_grey)
