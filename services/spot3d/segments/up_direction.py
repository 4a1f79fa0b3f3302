"""Which way is up, however the camera is rolled: by the supports of earlier keyframes."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

# With 10 to 100 votes, at least 3 to 10 of them and 8 to 30 degrees, up is right within 5 degrees in every keyframe of
# redkitchen (some have a wall as their support), TUM's cabinet and clutter.
_VOTES = 30
"""Number of keyframes remembered, ten seconds: some of them may have a wrong support."""
_FEWEST = 5
"""With fewer keyframes than this, up is unknown."""
_ALIKE = float(np.cos(np.radians(15)))
"""Supports whose normals agree to 15 degrees agree on up: tables and floors are level, walls are 90 degrees off."""


class UpDirection:
    """Remembers the normals of keyframes' supports in the world frame, where up stays when the camera rolls."""

    def __init__(self) -> None:
        self._normals: deque[NDArray[np.float64]] = deque(maxlen=_VOTES)

    def in_camera(self, T_world_camera: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(3,) unit vector up in the camera frame of this (4, 4) pose; None unless a majority of keyframes agrees."""
        if len(self._normals) < _FEWEST:
            return None
        normals = np.array(self._normals)
        agreeing = normals @ normals.T > _ALIKE
        most = agreeing[agreeing.sum(axis=1).argmax()]
        if 2 * int(most.sum()) <= len(normals):
            return None
        up = normals[most].sum(axis=0)
        return np.asarray(T_world_camera[:3, :3].T @ (up / np.linalg.norm(up)))

    def learn(self, normal: NDArray[np.float64]) -> None:
        """Add the unit normal (3,), world, of a keyframe's main support."""
        self._normals.append(normal)
