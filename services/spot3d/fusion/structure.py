"""What is no object: supporting planes and walls, remembered from the keyframes (paper, Sec. IV-A and IV-D)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_REMEMBERED = 10_000
"""Most keyframe planes kept; beyond, every second one goes."""
_ROUNDS = 100
"""Most rounds of K-means."""
_SAME_ANGLE, _SAME_DISTANCE = np.cos(np.deg2rad(12.0)), 0.05


@dataclass(frozen=True, slots=True)
class KeyframePlane:
    """A plane of one keyframe: (4,) float64 in the world frame, its heat, and whether it was the one removed."""

    plane: NDArray[np.float64]
    heat: float
    removed: bool


@dataclass(frozen=True, slots=True)
class StructurePlane:
    """Keyframe planes that are one: (4,) world frame, the share of keyframes that removed it, its heat."""

    plane: NDArray[np.float64]
    removed_share: float
    heat: float


def _k_means(features: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.int64]:
    """The cluster of each of (n, d) features, by Lloyd's algorithm from the given centres (k, d): (n,) int64."""
    labels = np.full(len(features), -1)
    for _ in range(_ROUNDS):
        nearest = np.argmin((centres**2).sum(axis=1) - 2 * features @ centres.T, axis=1)
        if np.array_equal(nearest, labels):
            break
        labels, size = nearest, np.bincount(nearest, minlength=len(centres))[:, None]
        sums = np.stack([np.bincount(labels, column, len(centres)) for column in features.T], axis=1)
        centres = np.where(size > 0, sums / np.maximum(size, 1), centres)
    return labels


class PlaneMemory:
    """The matrix P* of the paper: the planes of the keyframes."""

    def __init__(self) -> None:
        self._planes: list[KeyframePlane] = []

    def add(self, plane: KeyframePlane) -> None:
        """Remember one keyframe's plane."""
        self._planes.append(plane)
        if len(self._planes) > _REMEMBERED:
            self._planes = self._planes[::2]

    def clear(self) -> None:
        """Forget every plane."""
        self._planes = []

    def copy(self) -> "PlaneMemory":
        """A memory of its own with the same planes."""
        other = PlaneMemory()
        other._planes = list(self._planes)
        return other

    def removed(self) -> NDArray[np.float64]:
        """The plane that each keyframe removed: (k, 4) float64, world."""
        return np.array([item.plane for item in self._planes if item.removed]).reshape(-1, 4)

    def distinct(self, around: NDArray[np.float64]) -> list[StructurePlane]:
        """The different planes among all, by K-means, those with most removed heat first (paper, Sec. IV-D).

        around: (3,) world point near the scene's middle, where positions of planes are compared. The number of
        clusters is that of the planes which differ by more than 12 degrees or 5 cm.
        """
        if not self._planes:
            return []
        stack = np.array([item.plane for item in self._planes])
        position = stack[:, :3] @ around + stack[:, 3]
        features = np.column_stack((stack[:, :3] * _SAME_DISTANCE / np.sqrt(2 - 2 * _SAME_ANGLE), position))
        centres = np.zeros((0, 4))
        far = np.ones(len(features), np.bool_)
        while far.any():
            centres = np.concatenate((centres, features[far][:1]))
            far &= np.linalg.norm(features - centres[-1], axis=1) > _SAME_DISTANCE
        labels, count = _k_means(features, centres), len(centres)
        removed, heat = np.array([(item.removed, item.removed * item.heat) for item in self._planes]).T
        size, share = np.bincount(labels, minlength=count), np.bincount(labels, removed, count) / max(1, removed.sum())
        normals = np.stack([np.bincount(labels, column, count) for column in stack.T[:3]], axis=1)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        offsets = _medians(labels, position, size) - normals @ around
        heats = np.bincount(labels, heat, count)
        groups = [
            StructurePlane(np.append(normals[k], offsets[k]), float(share[k]), float(heats[k]))
            for k in np.flatnonzero(size)
        ]
        return sorted(groups, key=lambda group: -group.heat)


def _medians(labels: NDArray[np.int64], values: NDArray[np.float64], size: NDArray[np.int64]) -> NDArray[np.float64]:
    """The median of each label's values, of which there are so many; any number where there are none."""
    ordered = values[np.lexsort((values, labels))]
    first = np.cumsum(size) - size
    low, high = first + np.maximum(size - 1, 0) // 2, first + size // 2
    last = len(values) - 1
    return np.asarray(ordered[np.minimum(low, last)] + ordered[np.minimum(high, last)]) / 2
