"""trajectory.txt: the camera's path in TUM format, a line a pose as it becomes known."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.run.bounded_file import BoundedFile
from spot3d.trajectory import tum_line

NAME = "trajectory.txt"
LIMIT_BYTES = 256 * 2**20
"""Longest file: a day at 30 frames a second."""


class TrajectoryFile(BoundedFile):
    """The file of the poses that are trusted."""

    def __init__(self, path: Path, limit_bytes: int = LIMIT_BYTES) -> None:
        super().__init__(path, limit_bytes, "poses")
        self._last_ns: int | None = None

    def leave(self, folder: Path) -> None:
        """As `BoundedFile.leave`; the next pose may be of any time."""
        self._last_ns = None
        super().leave(folder)

    def add_pose(self, stamp_ns: int, T_world_camera: NDArray[np.float64]) -> None:
        """A frame's pose, (4, 4); one that is not later than the last is left out: readers rely on the order."""
        if self._last_ns is None or stamp_ns > self._last_ns:
            self._last_ns = stamp_ns
            self.add(tum_line(stamp_ns, T_world_camera))
