"""Which way is up, however the camera is held: by what the keyframes before stood on."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from spot3d.frame_segments import FrameSegments

# With 10 to 100 votes, 3 to 10 at least and 8 to 30 degrees up comes out within 5 degrees in every keyframe of
# redkitchen (some with a wall for their support), TUM's cabinet and clutter.
_VOTES = 30
"""So many keyframes are remembered, ten seconds: of these some may have stood on something else."""
_FEWEST = 5
"""Fewer keyframes than this say nothing."""
_ALIKE = float(np.cos(np.radians(15)))
"""Supports that face the same way to 15 degrees agree: tables and floors are level, walls are 90 degrees off."""


class Upward:
    """Remembers which way the supports of keyframes faced; a camera may roll, what is up in the world stays."""

    def __init__(self) -> None:
        self._normals: deque[NDArray[np.float64]] = deque(maxlen=_VOTES)

    def in_camera(self, T_world_camera: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(3,) unit vector up in the camera frame of this (4, 4) pose; None as long as no majority says so."""
        if len(self._normals) < _FEWEST:
            return None
        normals = np.array(self._normals)
        agreeing = normals @ normals.T > _ALIKE
        most = agreeing[agreeing.sum(axis=1).argmax()]
        if 2 * int(most.sum()) <= len(normals):
            return None
        up = normals[most].sum(axis=0)
        return np.asarray(T_world_camera[:3, :3].T @ (up / np.linalg.norm(up)))

    def learn(self, found: FrameSegments, T_world_camera: NDArray[np.float64]) -> None:
        """Take a keyframe's main support into account."""
        if len(found.planes):
            self._normals.append(T_world_camera[:3, :3] @ found.planes[0, :3])
