"""A recording without end."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.bench.material import to_and_fro
from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source.halving import halve
from spot3d.source.sequence import FrameSequence


class Looped:
    """`length` half-size frames: the first ones of a sequence, to and fro, so that the camera never jumps.

    They are held in memory, come at `rate_hz`, and carry no poses: odometry has to find them, over and over.
    """

    has_true_poses = False

    def __init__(self, full: FrameSequence, frames: int, length: int, rate_hz: float) -> None:
        count = min(frames, len(full))
        self._frames = [replace(halve(full[index]), T_world_camera=None) for index in range(count)]
        self.rate_hz = rate_hz
        self.stamps_ns = [round(step * 1e9 / rate_hz) + 1 for step in range(length)]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, index: int) -> RgbdFrame:
        return replace(self._frames[to_and_fro(len(self._frames), index)], stamp_ns=self.stamps_ns[index])

    def __iter__(self) -> Iterator[RgbdFrame]:
        return map(self.__getitem__, range(len(self)))

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of all frames."""
        return self._frames[0].intrinsics

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        """None: nobody tells them."""
        return None
