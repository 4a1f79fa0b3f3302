"""What registering a frame to a local map gives, and what a registrar is."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import SurfelMap

# A share of the points is enough to judge a fit.
_STRIDE = 4


@dataclass(frozen=True, slots=True)
class Registration:
    """A frame registered to the local map.

    T_world_camera: (4, 4) float64; overlap: share of the points that meet the map, [0, 1];
    residual: root mean square distance of the matched points to the map, metres.
    """

    T_world_camera: NDArray[np.float64]
    overlap: float
    residual: float


class Registrar(Protocol):
    """A local map and the way to register a frame to it; it changes its map only in `insert`."""

    def register(self, surface: Surface, T_world_guess: NDArray[np.float64], wide: bool) -> Registration:
        """Register the surface starting from a guess; `wide` reaches further, for a guess that is poor."""
        ...

    def insert(self, surface: Surface, T_world_camera: NDArray[np.float64]) -> None:
        """Add a frame whose registration was accepted."""
        ...

    @property
    def forgotten(self) -> int:
        """How many surfels a full map has dropped so far."""
        ...


def judged(planes: SurfelMap, surface: Surface, T_world_camera: NDArray[np.float64], distance: float) -> Registration:
    """How well a surface at a pose fits the map: a point meets it within `distance` metres of its plane."""
    _, _, (tried, matched, squares) = planes.normal_equations(surface, T_world_camera, distance, 1.0, _STRIDE)
    return Registration(T_world_camera, matched / max(tried, 1), (squares / max(matched, 1)) ** 0.5)
