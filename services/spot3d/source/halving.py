"""Frames at half size: a quarter of the work for every stage after."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source.sequence import FrameSequence

# Weights that average colour around each kept pixel, so that colour stays registered with the kept depth.
AROUND = np.array([0.25, 0.5, 0.25])


def halve(frame: RgbdFrame) -> RgbdFrame:
    """The frame with every second pixel: colour averaged around each, depth as it is, never averaged."""
    smooth = np.asarray(cv2.sepFilter2D(frame.colour, -1, AROUND, AROUND), np.uint8)
    return RgbdFrame(
        frame.stamp_ns,
        np.ascontiguousarray(smooth[::2, ::2]),
        frame.depth[::2, ::2].copy(),
        frame.depth_scale,
        frame.intrinsics.halved(),
        frame.T_world_camera,
    )


class Halved:
    """A sequence whose frames are those of another at half size."""

    def __init__(self, full: FrameSequence) -> None:
        self.full = full

    def __len__(self) -> int:
        return len(self.full)

    def __getitem__(self, index: int) -> RgbdFrame:
        return halve(self.full[index])

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (halve(frame) for frame in self.full)

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of the half-size frames."""
        return self.full.intrinsics.halved()

    @property
    def stamps_ns(self) -> list[int]:
        """Capture times in integer nanoseconds."""
        return self.full.stamps_ns

    @property
    def rate_hz(self) -> float:
        """Recorded rate in frames per second."""
        return self.full.rate_hz

    @property
    def has_true_poses(self) -> bool:
        """Whether any frame comes with a true pose."""
        return self.full.has_true_poses

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        """T_world_camera (4, 4) float64 of a frame, without reading its images."""
        return self.full.true_pose(index)
