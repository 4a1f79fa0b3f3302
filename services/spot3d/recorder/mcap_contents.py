"""Reads our MCAP files, finished or not: chunks are found without the summary at the end."""

import io
import logging
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import breakup_chunk

from spot3d.recorder.profile import MAGIC, PROFILE, is_our_mcap
from spot3d.source.errors import SourceError

log = logging.getLogger(__name__)

_RECORD = struct.Struct("<BQ")
_CHUNK_TIMES = struct.Struct("<QQ")
_LONGEST_CHUNK = 2**30
"""A chunk holds 16 MB and one message. A record that claims to be longer than this is broken."""


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """Offset and length of a chunk's record in the file, and the log times of its first and last message."""

    offset: int
    length: int
    start_ns: int
    end_ns: int


@dataclass(slots=True)
class McapContents:
    """An opened recording.

    channels: by id. metadata: values by name. complete: whether the recording was finished; if not, the last
    `lost_bytes` bytes form no complete record.
    """

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    complete: bool = False
    lost_bytes: int = 0

    @property
    def topics(self) -> dict[str, int]:
        """Channel ids by topic, named as in the table of topics: `source/frame`."""
        return {channel.metadata.get("topic", channel.topic): number for number, channel in self.channels.items()}

    @property
    def start_ns(self) -> int:
        """Log time of the first message; 0 of an empty recording."""
        return min((chunk.start_ns for chunk in self.chunks), default=0)

    @property
    def end_ns(self) -> int:
        """Log time of the last message; 0 of an empty recording."""
        return max((chunk.end_ns for chunk in self.chunks), default=0)

    @property
    def robot(self) -> str:
        """Name of the recorded robot."""
        return self.metadata.get("spot3d", {}).get("robot", "robot")

    def messages(self, chunk: ChunkPlace) -> list[Message]:
        """The messages of one chunk, sorted by log time. Raises SourceError if it is damaged."""
        try:
            with self.path.open("rb") as stream:
                stream.seek(chunk.offset)
                records = breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
        except (McapError, ValueError, struct.error, zstandard.ZstdError, MemoryError) as error:
            raise SourceError(f"{self.path} is damaged at byte {chunk.offset}: {error}") from error
        return sorted((item for item in records if isinstance(item, Message)), key=lambda item: item.log_time)

    def between(self, start_ns: int, end_ns: int, complain: Callable[[str], None]) -> Iterator[Message]:
        """The messages logged from start_ns to end_ns, both included. complain: called at the end with any damage."""
        damaged = []
        for chunk in self.chunks:
            if chunk.end_ns < start_ns or chunk.start_ns > end_ns:
                continue
            try:
                messages = self.messages(chunk)
            except SourceError as error:
                damaged.append(str(error))
                continue
            yield from (item for item in messages if start_ns <= item.log_time <= end_ns)
        if damaged:
            complain(f"left out {len(damaged)} of {len(self.chunks)} chunks of messages: {damaged[0]}")


def open_mcap(path: Path) -> McapContents:
    """Opens a recording. Messages are read on access. Raises SourceError if the file is none of ours, OSError."""
    if not path.exists():
        raise SourceError(f"{path} does not exist; give a file written by spot3d record")
    if not is_our_mcap(path):
        raise SourceError(f"{path} is not a recording of spot3d (an MCAP file with the profile {PROFILE!r})")
    contents = McapContents(path)
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(len(MAGIC))
        at = len(MAGIC)
        while not contents.complete:
            head = stream.read(_RECORD.size)
            if len(head) < _RECORD.size:
                break
            opcode, length = _RECORD.unpack(head)
            after = at + _RECORD.size + length
            if after > size or length > _LONGEST_CHUNK or not 0 < opcode <= Opcode.DATA_END:
                break
            try:
                _take(contents, opcode, length, stream)
            except (McapError, ValueError, struct.error) as error:
                log.warning("%s is damaged at byte %d, and that record is left out: %s", path, at, error)
            stream.seek(after)
            at = after
    contents.lost_bytes = 0 if contents.complete else size - at
    return contents


def _take(contents: McapContents, opcode: int, length: int, stream: IO[bytes]) -> None:
    """Add one record to the contents. Its body begins at the stream's position."""
    if opcode == Opcode.CHUNK:
        start_ns, end_ns = _CHUNK_TIMES.unpack(stream.read(_CHUNK_TIMES.size))
        contents.chunks.append(ChunkPlace(stream.tell() - _CHUNK_TIMES.size, length, start_ns, end_ns))
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(_body(stream, length))
        contents.channels[channel.id] = channel
    elif opcode == Opcode.METADATA:
        record = Metadata.read(_body(stream, length))
        contents.metadata[record.name] = record.metadata
    elif opcode == Opcode.DATA_END:
        contents.complete = True


def _body(stream: IO[bytes], length: int) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(stream.read(length)))
