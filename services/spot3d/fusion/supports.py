"""The supporting surfaces seen recently, for display."""

import numpy as np
from numpy.typing import NDArray

_SAME_COSINE = np.cos(np.radians(10))
_SAME_M = 0.05
"""Planes within 10 degrees and 5 cm, measured below the camera that sees them, are one."""
_MOST = 8


class RecentSupports:
    """The latest distinct supporting planes, at most eight; the one seen longest ago goes first."""

    def __init__(self) -> None:
        self._planes: list[NDArray[np.float64]] = []

    def planes(self) -> NDArray[np.float64]:
        """(p, 4) float64 [n_x, n_y, n_z, b], world frame, metres, n.x + b = 0; the latest last."""
        return np.array(self._planes).reshape(-1, 4)

    def add(self, plane: NDArray[np.float64], eye: NDArray[np.float64]) -> None:
        """Add a plane (4,), world, seen from the point `eye` (3,); it replaces similar ones."""
        foot = eye - (plane[:3] @ eye + plane[3]) * plane[:3]
        others = [
            old for old in self._planes if old[:3] @ plane[:3] < _SAME_COSINE or abs(old[:3] @ foot + old[3]) > _SAME_M
        ]
        self._planes = [*others, plane][-_MOST:]
