"""Selects what a run plays: an input by its path or name, and which of its frames."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import DepthNoise, parse_noise
from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.halving import halve
from spot3d.source.intrinsics_files import FocalAndCentre, parse_intrinsics
from spot3d.source.realsense.camera import is_camera
from spot3d.source.ros.topics import TopicNames
from spot3d.source.sequence import Derived, FrameSequence, FrameStream, Note
from spot3d.source.sequences import SCENE_FRAMES, open_source, open_stream
from spot3d.source.settings import SourceSettings


@dataclass(frozen=True, slots=True)
class Selection:
    """Which input to play, and which of its frames.

    frames: at most this many; None: all. every: only every n-th. after_ns: only frames of a recording captured later,
    so that a restarted source goes on where it stopped. It does not apply to a camera, whose clock may have been set
    since.
    """

    name: str
    frames: int | None = None
    every: int = 1
    intrinsics: FocalAndCentre | None = None
    after_ns: int | None = None

    def __post_init__(self) -> None:
        if self.every < 1 or (self.frames is not None and self.frames < 1):
            raise SourceError("--every and --frames must be at least 1")


def selection(
    name: str, frames: int | None, every: int, intrinsics: str | None, after_ns: int | None = None
) -> Selection:
    """A selection from command-line values. intrinsics: FX,FY,CX,CY. Raises SourceError if they are malformed."""
    return Selection(name, frames, every, None if intrinsics is None else parse_intrinsics(intrinsics), after_ns)


def open_selection(selection: Selection, settings: SourceSettings) -> FrameSequence:
    """The selected frames of the input, at half size where the settings say so. Raises SourceError."""
    name, every = selection.name, selection.every
    length = SCENE_FRAMES if selection.frames is None else selection.frames * every
    topics = TopicNames(settings.colour_topic, settings.depth_topic, settings.pose_topic)
    sequence = open_source(name, length, selection.intrinsics, settings.halved, topics, settings.depth_unit)
    noise = parse_noise(settings.depth_noise) if settings.depth_noise else None
    all_of_it = every == 1 and selection.after_ns is None and (selection.frames or len(sequence)) >= len(sequence)
    if all_of_it and noise is None:
        return sequence
    chosen = range(0, len(sequence), every)[: selection.frames]
    if selection.after_ns is not None:
        stamps = sequence.stamps_ns
        chosen = chosen[sum(stamps[index] <= selection.after_ns for index in chosen) :]
    return Selected(sequence, chosen, noise)


def open_selected_stream(selection: Selection, settings: SourceSettings) -> FrameStream:
    """The selected frames of a camera, at half size where the settings say so. Raises SourceError."""
    if selection.intrinsics is not None:
        raise SourceError(f"{selection.name} states its own intrinsics; omit --intrinsics")
    if settings.depth_unit:
        raise SourceError(f"{selection.name} states its own unit of depth; omit --depth-unit")
    return _SelectedStream(open_stream(selection.name), selection, settings)


class _SelectedStream:
    """Some frames of a camera."""

    def __init__(self, camera: FrameStream, selection: Selection, settings: SourceSettings) -> None:
        self._camera, self._selection, self._halved = camera, selection, settings.halved
        self._noise = parse_noise(settings.depth_noise) if settings.depth_noise else None

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """The camera's frames, until `frames` of them are selected. None while none comes."""
        after_ns = None if is_camera(self._selection.name) else self._selection.after_ns
        came = given = 0
        for frame in self._camera.stream(stop, note):
            if frame is None:
                yield None
                continue
            if came % self._selection.every == 0:
                played = after_ns is not None and frame.stamp_ns <= after_ns
                yield None if played else self._prepared(frame)
                given += 1
            came += 1
            if given == self._selection.frames:
                return

    def _prepared(self, frame: RgbdFrame) -> RgbdFrame:
        frame = _with_noise(frame, self._noise)
        return halve(frame) if self._halved else frame


class Selected(Derived):
    """Some frames of another sequence. noise: a depth noise model that replaces theirs, if given."""

    def __init__(self, original: FrameSequence, indices: range, noise: DepthNoise | None = None) -> None:
        super().__init__(original)
        self._indices = indices
        self._noise = noise
        self.stamps_ns = [original.stamps_ns[index] for index in indices]
        if noise is not None:
            self.intrinsics = replace(original.intrinsics, noise=noise)

    @property
    def rate_hz(self) -> float:
        """Rate of the selected frames, frames per second."""
        return self.original.rate_hz / self._indices.step

    def at_half_size(self) -> "Selected":
        return Selected(self.original.at_half_size(), self._indices, self._noise)

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return self.original.true_pose(self._indices[index])

    def __getitem__(self, index: int) -> RgbdFrame:
        return _with_noise(self.original[self._indices[index]], self._noise)


def _with_noise(frame: RgbdFrame, noise: DepthNoise | None) -> RgbdFrame:
    """The frame with this depth noise model. None: with its own."""
    return frame if noise is None else replace(frame, intrinsics=replace(frame.intrinsics, noise=noise))
