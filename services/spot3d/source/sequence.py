"""What every input looks like to the rest of the source stage."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from threading import Event
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame

Note = Callable[[str, str], None]
"""Told what happened: its kind, and a sentence."""
CAMERA_MISSING, CAMERA_LOST = "camera missing", "camera lost"
CAMERA_GONE = (CAMERA_MISSING, CAMERA_LOST)
"""What is told of a camera that is waited for."""


@runtime_checkable
class FrameStream(Protocol):
    """A camera, or what behaves like one: frames come when they come, and only once."""

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """Frames until the stream ends, or until `stop`; None, every few seconds or sooner, while none comes.

        note: is told when a camera is found, missing or lost.
        """


def median_rate_hz(stamps_ns: Sequence[int] | NDArray[np.int64]) -> float:
    """Frames per second, by the median gap between stamps; 30 for a single frame."""
    gaps = np.diff(stamps_ns)
    return 1e9 / float(np.median(gaps)) if gaps.size else 30.0


class FrameSequence(Protocol):
    """Frames made or read when asked for; what is known without reading images is at hand at once."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of all frames."""

    @property
    def stamps_ns(self) -> list[int]:
        """Capture times in integer nanoseconds, ascending."""

    @property
    def rate_hz(self) -> float:
        """Recorded rate in frames per second."""

    @property
    def has_true_poses(self) -> bool:
        """Whether any frame comes with a true pose."""

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        """T_world_camera (4, 4) float64 of a frame, or None."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> RgbdFrame: ...

    def __iter__(self) -> Iterator[RgbdFrame]: ...


class FrameList:
    """A sequence of frames that are there already; their poses are the true ones."""

    def __init__(self, frames: Iterable[RgbdFrame] = ()) -> None:
        self.frames = list(frames)

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of the first frame, which all have."""
        return self.frames[0].intrinsics

    @property
    def stamps_ns(self) -> list[int]:
        """Capture times in integer nanoseconds."""
        return [frame.stamp_ns for frame in self.frames]

    @property
    def rate_hz(self) -> float:
        """Rate in frames per second."""
        return median_rate_hz(self.stamps_ns)

    @property
    def has_true_poses(self) -> bool:
        """Whether any frame comes with a pose."""
        return any(frame.T_world_camera is not None for frame in self.frames)

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        """T_world_camera (4, 4) float64 of a frame, or None."""
        return self.frames[index].T_world_camera

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> RgbdFrame:
        return self.frames[index]

    def __iter__(self) -> Iterator[RgbdFrame]:
        return iter(self.frames)


class Derived:
    """A sequence made of another: what a subclass does not say otherwise is as it is there."""

    def __init__(self, original: FrameSequence) -> None:
        self.original = original

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of all frames."""
        return self.original.intrinsics

    @property
    def stamps_ns(self) -> list[int]:
        """Capture times in integer nanoseconds."""
        return self.original.stamps_ns

    @property
    def rate_hz(self) -> float:
        """Rate in frames per second."""
        return self.original.rate_hz

    @property
    def has_true_poses(self) -> bool:
        """Whether any frame comes with a true pose."""
        return self.original.has_true_poses

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        """T_world_camera (4, 4) float64 of a frame, or None, without reading its images."""
        return self.original.true_pose(index)

    def __len__(self) -> int:
        return len(self.original)

    def __getitem__(self, index: int) -> RgbdFrame:
        return self.original[index]

    def __iter__(self) -> Iterator[RgbdFrame]:
        return (self[index] for index in range(len(self)))
