"""Frames of a recording that `spot3d record` has written, as an input."""

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.order import RESTART_NS
from spot3d.frame import RgbdFrame
from spot3d.recorder.mcap_contents import McapContents, open_mcap
from spot3d.source.errors import SourceError
from spot3d.source.recording import of_first_readable
from spot3d.source.sequence import FrameSequence
from spot3d_schemas import CodecError, Frame, Heat, decode, peek_header

log = logging.getLogger(__name__)


class _Place(NamedTuple):
    """Where one frame is: its chunk, its number among that chunk's frames, its stamp, and its stream's name or ""."""

    chunk: int
    number: int
    stamp_ns: int
    stream: str


_MESSAGES: dict[str, type[Frame] | type[Heat]] = {"source/frame": Frame, "heatmap/heat": Heat}
"""Messages that hold an RGB-D frame. A heat message includes its frame, for recordings of links that carry only heat.
"""


class McapSequence(FrameSequence):
    """A sequence of RgbdFrame, read on access. Of several streams in the recording, it is the longest."""

    def __init__(self, path: Path) -> None:
        """Opens a recording. Raises SourceError where it holds no frames, or saying what is wrong with it."""
        self._contents = contents = open_mcap(path)
        self._topic = next((topic for topic in _MESSAGES if topic in contents.topics), "")
        try:
            places = _places(contents, self._topic) if self._topic else []
        except (CodecError, TypeError, ValueError) as error:
            raise SourceError(f"{contents.path}: cannot index its frames: {error}") from error
        if not places:
            raise SourceError(
                f"{contents.path} contains no frames: it has no messages on source/frame or heatmap/heat; its topics "
                f"are {', '.join(contents.topics) or 'none'}"
            )
        if not contents.complete:
            log.warning("%s is incomplete: its last %d bytes are lost", contents.path, contents.lost_bytes)
        streams = _streams(places)
        stragglers = len(places) - sum(map(len, streams))
        if stragglers:
            told = "a timestamp no later than the one before, and are left out"
            log.warning("%s: %d of %d frames have %s", contents.path, stragglers, len(places), told)
        self._places = max(streams, key=len)
        if len(streams) > 1:
            told = ", ".join(str(len(stream)) for stream in streams)
            log.warning(
                "%s contains %d streams, of %s frames; the longest is played", contents.path, len(streams), told
            )
        self._chunk: tuple[int, list[bytes]] = (-1, [])
        self.stamps_ns = [place.stamp_ns for place in self._places]
        first = of_first_readable(range(len(self)), self.__getitem__, f"frames of {path} can be read")
        # Those of the first frame: other frames may have other intrinsics.
        self.intrinsics, self._has_poses = first.intrinsics, first.T_world_camera is not None

    @property
    def has_true_poses(self) -> bool:
        """Whether the first readable frame has a pose from its source."""
        return self._has_poses

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return self[index].T_world_camera

    def __getitem__(self, index: int) -> RgbdFrame:
        """Reads one frame. Raises SourceError where the file is damaged there."""
        chunk, number, *_ = self._places[index]
        try:
            if self._chunk[0] != chunk:
                self._chunk = (chunk, _messages(self._contents, chunk, self._topic))
            frame = rgbd_frame(decode(self._chunk[1][number], _MESSAGES[self._topic]))
        except (CodecError, IndexError) as error:
            raise SourceError(f"{self._contents.path}, frame {index}: {error}") from error
        return replace(frame, colour=frame.colour.copy(), depth=frame.depth.copy())


def _messages(contents: McapContents, chunk: int, topic: str) -> list[bytes]:
    wanted, messages = contents.topics[topic], contents.messages(contents.chunks[chunk])
    return [item.data for item in messages if item.channel_id == wanted]


def _places(contents: McapContents, topic: str) -> list[_Place]:
    """Where each frame is: from the recorder's own list or, where it could not write one, by reading all messages."""
    places: list[_Place] = []
    for chunk, stamp_ns, stream in _listed(contents, topic) or _searched(contents, topic):
        number = places[-1].number + 1 if places and places[-1].chunk == chunk else 0
        places.append(_Place(chunk, number, stamp_ns, stream))
    return places


def _listed(contents: McapContents, topic: str) -> list[tuple[int, int, str]]:
    """Chunk, stamp and stream of each frame as a finished recording lists them. Empty if it has no such list."""
    listed = contents.metadata.get("frames", {})
    if listed.get("topic") != topic:
        return []
    rows = json.loads(listed.get("chunk_stamp_ns_stream", "[]"))
    return [(int(chunk), int(stamp_ns), str(stream)) for chunk, stamp_ns, stream in rows]


def _searched(contents: McapContents, topic: str) -> Iterator[tuple[int, int, str]]:
    """Chunk, stamp and stream of each frame, found by reading. A damaged chunk's frames are skipped."""
    for chunk in range(len(contents.chunks)):
        try:
            messages = _messages(contents, chunk, topic)
        except SourceError as error:
            log.warning("the frames of a damaged chunk are left out: %s", error)
            continue
        for data in messages:
            header = peek_header(data)
            yield chunk, header.stamp_ns, header.stream or ""


def _streams(places: list[_Place]) -> list[list[_Place]]:
    """Splits the frames where the stream's name changes or the stamp goes back by RESTART_NS. Drops stragglers."""
    streams = [places[:1]]
    for place in places[1:]:
        last = streams[-1][-1]
        if place.stream != last.stream or last.stamp_ns - place.stamp_ns >= RESTART_NS:
            streams.append([place])
        elif place.stamp_ns > last.stamp_ns:
            streams[-1].append(place)
    return streams
