"""Frames of a recording on disk, read on access."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source.calibration import SEVEN_SCENES_COLOUR, ColourCamera
from spot3d.source.errors import SourceError
from spot3d.source.halving import halve
from spot3d.source.images import read_colour, read_depth
from spot3d.source.sequence import FrameSequence

if TYPE_CHECKING:
    from spot3d.source.colour_registration import ColourRegistration

E = TypeVar("E")
T = TypeVar("T")
_READABLE = "frames has readable depth and colour images"


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """One frame's capture time in ns, its two files, and its true pose if the data set has one."""

    stamp_ns: int
    colour: Path
    depth: Path
    T_world_camera: NDArray[np.float64] | None


@dataclass(eq=False)
class Recording(FrameSequence):
    """A sequence of RgbdFrame in the depth camera's geometry. Images are read on access.

    camera: intrinsics of the depth images. depth_scale: metres per unit. colour_camera: the calibration to register
    colour with, or None if colour is registered already. invalid: a depth value that means "nothing measured", besides
    0. halved: frames have half the size of the images.
    """

    frames: list[RecordedFrame]
    camera: Intrinsics
    depth_scale: float
    colour_camera: ColourCamera | None = None
    invalid: int = 0
    halved: bool = False

    def __post_init__(self) -> None:
        self.stamps_ns = [frame.stamp_ns for frame in self.frames]
        self.intrinsics = self.camera.halved() if self.halved else self.camera

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return self.frames[index].T_world_camera

    @property
    def colour_by_default(self) -> bool:
        """Whether colour is registered by 7-Scenes' calibration because the folder states none."""
        return self.colour_camera is SEVEN_SCENES_COLOUR

    @cached_property
    def registration(self) -> "ColourRegistration | None":
        """Registers colour with depth at the frames' size. None if colour is registered already."""
        if self.colour_camera is None:
            return None
        # Imported here: its kernels are slow to import, and stamps and poses do not need them.
        from spot3d.source.colour_registration import ColourRegistration

        camera = self.colour_camera.averaged() if self.halved else self.colour_camera
        return ColourRegistration(self.intrinsics, camera)

    def at_half_size(self) -> "Recording":
        return replace(self, halved=True)

    def __getitem__(self, index: int) -> RgbdFrame:
        """Reads one frame. Raises SourceError if a file is missing, unreadable or of the wrong size."""
        entry = self.frames[index]
        depth, colour = self.images(entry)
        if self.registration is None:
            frame = RgbdFrame(entry.stamp_ns, colour, depth, self.depth_scale, self.camera, entry.T_world_camera)
            return halve(frame) if self.halved else frame
        if self.halved:
            # Halved first: registering all pixels and dropping three of four takes four times as long.
            depth = depth[::2, ::2].copy()
            colour = _averaged(colour, self.registration.camera.intrinsics.shape)
        metres = depth.astype(np.float32) * np.float32(self.depth_scale)
        colour = self.registration.register(colour, metres)
        return RgbdFrame(entry.stamp_ns, colour, depth, self.depth_scale, self.intrinsics, entry.T_world_camera)

    def images(self, entry: RecordedFrame) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        """A frame's depth and colour at full size. Invalid depth is 0. Raises SourceError as `__getitem__` does."""
        depth = read_depth(entry.depth)
        if self.invalid:
            depth[depth == self.invalid] = 0
        _require_size(entry.depth, depth.shape, self.camera)
        colour = read_colour(entry.colour)
        camera = self.camera if self.colour_camera is None else self.colour_camera.intrinsics
        _require_size(entry.colour, colour.shape[:2], camera)
        return depth, colour


def first_readable_shape(frames: list[RecordedFrame]) -> tuple[int, int]:
    """Depth's shape (h, w) in the first frame whose two images can be read. Raises SourceError if there is none."""

    def shape(entry: RecordedFrame) -> tuple[int, int]:
        read_colour(entry.colour)
        height, width = read_depth(entry.depth).shape
        return height, width

    return of_first_readable(frames, shape, _READABLE)


def with_a_readable_frame(recording: Recording) -> Recording:
    """The recording. Raises SourceError if it has no frame whose images can be read and have their camera's size."""
    of_first_readable(recording.frames, recording.images, _READABLE)
    return recording


def of_first_readable(entries: Sequence[E], read: Callable[[E], T], what: str) -> T:
    """What `read` returns for the first entry for which it does not raise SourceError. Raises one if it always does.

    what: continues `none of so many` in that error.
    """
    refused: SourceError | None = None
    for entry in entries:
        try:
            return read(entry)
        except SourceError as error:
            refused = refused or error
    raise SourceError(f"none of {len(entries)} {what}; the first error: {refused}")


def _averaged(colour: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Means of blocks of 2 x 2 pixels. shape: the result's; an incomplete last row or column is dropped."""
    rows, columns = shape
    whole = colour[: 2 * rows, : 2 * columns]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)


def _require_size(path: Path, shape: tuple[int, ...], intrinsics: Intrinsics) -> None:
    if shape != intrinsics.shape:
        raise SourceError(
            f"size mismatch: {path} is {shape[1]}x{shape[0]}, but the camera's intrinsics are for "
            f"{intrinsics.width}x{intrinsics.height}; all images of a camera must have one size, and colour that of "
            "depth unless calibration.json states another"
        )
