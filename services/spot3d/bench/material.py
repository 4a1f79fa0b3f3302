"""Input of the measurements: frames in memory, with the results of the stages before the measured one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.heatmap.heat import weighted_heat
from spot3d.proposals.propose import propose
from spot3d.settings import Settings
from spot3d.source.errors import SourceError


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """Consecutive frames of one data set at one size.

    depth: (h, w) float32 metres each; boxes: (M, 5) float32 each; heat: (h, w) uint8 each.
    """

    data: str
    frames: list[RgbdFrame]
    depth: list[NDArray[np.float32]]
    boxes: list[NDArray[np.float32]]
    heat: list[NDArray[np.uint8]]

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def camera(self) -> Intrinsics:
        """Intrinsics of all frames."""
        return self.frames[0].intrinsics

    @property
    def size(self) -> str:
        """Width and height, as tables state them."""
        return f"{self.camera.width}x{self.camera.height}"

    def first(self, count: int) -> "Material":
        """The first `count` frames."""
        return Material(self.data, self.frames[:count], self.depth[:count], self.boxes[:count], self.heat[:count])

    def pose(self, index: int) -> NDArray[np.float64]:
        """True T_world_camera (4, 4) of a frame. Raises SourceError where the data has none."""
        pose = self.frames[index].T_world_camera
        if pose is None:
            raise SourceError(f"{self.data}: frame {index} has no true pose, which measuring fusion needs")
        return pose


def prepare(data: str, frames: list[RgbdFrame], settings: Settings) -> Material:
    """Run the stages before fusion over the frames."""
    depth = [frame.depth_metres() for frame in frames]
    boxes = [
        propose(frame.colour, metres, frame.intrinsics, settings.proposals)
        for frame, metres in zip(frames, depth, strict=True)
    ]
    heat = [
        weighted_heat(metres, frame.intrinsics, found, settings.heatmap).heat
        for frame, metres, found in zip(frames, depth, boxes, strict=True)
    ]
    return Material(data, frames, depth, boxes, heat)


def to_and_fro(count: int, step: int) -> int:
    """Index of the frame at a step of a walk through `count` frames, forwards and back, without jumps."""
    if count == 1:
        return 0
    place = step % (2 * count - 2)
    return place if place < count else 2 * count - 2 - place


def walking(count: int, call: Callable[[int], object], start: int = 0) -> Callable[[], object]:
    """A function without arguments that calls `call` with the next frame's index each time, to and fro."""
    step = start - 1

    def next_frame() -> object:
        nonlocal step
        step += 1
        return call(to_and_fro(count, step))

    return next_frame
