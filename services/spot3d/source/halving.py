"""Frames at half size: a quarter of the work for every stage after."""

from dataclasses import replace

import cv2
import numpy as np

from spot3d.frame import RgbdFrame
from spot3d.source.sequence import Derived, FrameSequence

# Weights that average colour around each kept pixel, so that colour stays registered with the kept depth.
AROUND = np.array([0.25, 0.5, 0.25])


def halve(frame: RgbdFrame) -> RgbdFrame:
    """The frame with every second pixel. Colour is averaged around each kept pixel; depth is never averaged."""
    smooth = np.asarray(cv2.sepFilter2D(frame.colour, -1, AROUND, AROUND), np.uint8)
    colour, depth = np.ascontiguousarray(smooth[::2, ::2]), frame.depth[::2, ::2].copy()
    return replace(frame, colour=colour, depth=depth, intrinsics=frame.intrinsics.halved())


class Halved(Derived):
    """A sequence whose frames are those of another at half size."""

    def __init__(self, original: FrameSequence) -> None:
        super().__init__(original)
        self.intrinsics = original.intrinsics.halved()

    def __getitem__(self, index: int) -> RgbdFrame:
        return halve(self.original[index])
