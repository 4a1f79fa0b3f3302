"""The interfaces of all inputs: sequences with random access, and streams."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from threading import Event
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame

Note = Callable[[str, str], None]
"""A callback that is told what happened: its kind, and a sentence."""
CAMERA_MISSING, CAMERA_LOST = "camera missing", "camera lost"
CAMERA_GONE = (CAMERA_MISSING, CAMERA_LOST)
"""Kinds of a note that mean waiting for a camera."""


@runtime_checkable
class FrameStream(Protocol):
    """A camera, or an input that behaves like one: frames come at their own pace, and only once."""

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """Frames until the stream ends or `stop` is set. Yields None every few seconds or sooner while none comes.

        note: is called when a camera is found, missing or lost.
        """


class FrameSequence(ABC):
    """Frames that are made or read on access. Intrinsics, stamps and poses are known without reading images.

    intrinsics: of all frames; stamps_ns: capture times in integer nanoseconds, ascending.
    """

    intrinsics: Intrinsics
    stamps_ns: list[int]

    @property
    def rate_hz(self) -> float:
        """Frames per second, from the median gap between different stamps. 30 for a single stamp."""
        # Of frames with the same stamp, such as whole seconds, only the first is played.
        gaps = np.diff(np.unique(self.stamps_ns))
        return 1e9 / float(np.median(gaps)) if gaps.size else 30.0

    @property
    def has_true_poses(self) -> bool:
        """Whether any frame comes with a true pose."""
        return any(self.true_pose(index) is not None for index in range(len(self)))

    @abstractmethod
    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        """T_world_camera (4, 4) float64 of a frame, or None."""

    @abstractmethod
    def __getitem__(self, index: int) -> RgbdFrame:
        """One frame. Raises SourceError if it cannot be read, IndexError beyond the sequence."""

    def at_half_size(self) -> "FrameSequence":
        """The same frames at half size."""
        from spot3d.source.halving import Halved  # is itself a sequence, and imports OpenCV

        return Halved(self)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (self[index] for index in range(len(self)))


class FrameList(FrameSequence):
    """A sequence of frames in memory. Their poses are the true ones."""

    def __init__(self, frames: Iterable[RgbdFrame] = ()) -> None:
        self.frames = list(frames)
        self.stamps_ns = [frame.stamp_ns for frame in self.frames]
        if self.frames:
            self.intrinsics = self.frames[0].intrinsics

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return self.frames[index].T_world_camera

    def __getitem__(self, index: int) -> RgbdFrame:
        return self.frames[index]


class Derived(FrameSequence):
    """A sequence made from another one, whose properties it has unless a subclass overrides them."""

    def __init__(self, original: FrameSequence) -> None:
        self.original = original
        self.intrinsics, self.stamps_ns = original.intrinsics, original.stamps_ns

    @property
    def rate_hz(self) -> float:
        return self.original.rate_hz

    @property
    def has_true_poses(self) -> bool:
        return self.original.has_true_poses

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return self.original.true_pose(index)
