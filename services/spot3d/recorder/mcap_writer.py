"""Writes MCAP files that are readable however the writing ends.

The mcap library's own writer compresses each chunk with zstd's default, which takes half a core for a VGA camera. This
one uses a longer window and a faster level. It finds a frame's images again in the heat message, so that the file is as
small at a third of the time.
"""

import struct
import zlib
from collections import Counter
from pathlib import Path

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from spot3d.recorder.profile import MAGIC

CHUNK_BYTES = 16 * 2**20
"""A chunk is finished once it holds this many bytes of messages: five VGA frames with their heat."""

_LEVEL, _WINDOW_LOG = -1, 23
"""A window of 8 MB reaches from a heat message back to its frame, and every zstd decoder accepts it (RFC 8878)."""
_CHUNK = struct.Struct("<BQQQQII4sQ")
"""A chunk record before its data: opcode, length, first and last log time, uncompressed size, CRC, "zstd", size.

The CRC is 0, none: zstd has its own, which takes a quarter of the time."""
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS = _MESSAGE.size - 9

ChannelSpec = tuple[str, str, bytes, str, str, dict[str, str]]
"""Arguments of `McapWriter.channel`: topic, schema name, schema, schema encoding, message encoding, metadata."""


class McapWriter:
    """Writes one file, in which every finished chunk stays readable. Not thread-safe.

    Every method that writes raises OSError if the file cannot take more. The file then ends with its last complete
    chunk, and `close` still adds the summary if there is room.
    """

    def __init__(self, path: Path, profile: str, library: str) -> None:
        """Create a new file. Raises FileExistsError rather than overwrite one."""
        self.size = 0
        self.kept: Counter[int] = Counter()
        """Number of messages in finished chunks, by channel."""
        self.start_ns = self.end_ns = 0
        """Log times of the first and last message in finished chunks."""
        self._file = path.open("xb", buffering=0)
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        parameters = zstandard.ZstdCompressionParameters.from_level(
            _LEVEL, window_log=_WINDOW_LOG, enable_ldm=True, write_checksum=True
        )
        self._compressor = zstandard.ZstdCompressor(compression_params=parameters)
        self._begin_chunk()
        self._write(MAGIC + _bytes_of(Header(profile, library)))

    @property
    def chunks(self) -> int:
        """Number of chunks in the file."""
        return len(self._chunks)

    def channel(
        self,
        topic: str,
        schema_name: str,
        schema: bytes,
        schema_encoding: str,
        message_encoding: str,
        metadata: dict[str, str],
    ) -> int:
        """Announce a channel. Returns its id, counted from 1.

        Channels and schemas are written outside the chunks, each once.
        """
        known = next((item for item in self._schemas if (item.name, item.data) == (schema_name, schema)), None)
        described = known or Schema(len(self._schemas) + 1, schema, schema_encoding, schema_name)
        channel = Channel(len(self._channels) + 1, topic, message_encoding, metadata, described.id)
        self._write(_bytes_of(*(() if known else (described,)), channel))
        self._schemas += [] if known else [described]
        self._channels.append(channel)
        return channel.id

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        record = _bytes_of(Metadata(name, values))
        at = self._write(record)
        self._metadata.append(MetadataIndex(length=len(record), name=name, offset=at))

    def add(self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes | memoryview) -> None:
        """Add a message to the chunk, which is written once it is full. Keeps no reference to `data`."""
        self._index.setdefault(channel, []).append((log_ns, self._chunk_bytes))
        fields = (Opcode.MESSAGE, _MESSAGE_FIELDS + len(data), channel, sequence & 0xFFFFFFFF, log_ns, publish_ns)
        self._packed += (self._packer.compress(_MESSAGE.pack(*fields)), self._packer.compress(data))
        self._chunk_bytes += _MESSAGE.size + len(data)
        if self._chunk_bytes >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Finish the chunk and write it, unless it is empty."""
        if not self._index:
            return
        packed, index, size = [*self._packed, self._packer.flush()], self._index, self._chunk_bytes
        self._begin_chunk()
        times = [log_ns for entries in index.values() for log_ns, _ in entries]
        first_ns, last_ns = min(times), max(times)
        packed_bytes = sum(map(len, packed))
        length = _CHUNK.size - 9 + packed_bytes
        head = _CHUNK.pack(Opcode.CHUNK, length, first_ns, last_ns, size, 0, 4, b"zstd", packed_bytes)
        offsets, indices = {}, b""
        for channel, entries in index.items():
            offsets[channel] = self.size + len(head) + packed_bytes + len(indices)
            indices += _bytes_of(MessageIndex(channel, entries))
        at = self._write(head, *packed, indices)
        place = ChunkIndex(
            chunk_length=len(head) + packed_bytes,
            chunk_start_offset=at,
            compression="zstd",
            compressed_size=packed_bytes,
            message_end_time=last_ns,
            message_index_length=len(indices),
            message_index_offsets=offsets,
            message_start_time=first_ns,
            uncompressed_size=size,
        )
        self.start_ns = min(self.start_ns, first_ns) if self._chunks else first_ns
        self.end_ns = max(self.end_ns, last_ns)
        self._chunks.append(place)
        self.kept.update({channel: len(entries) for channel, entries in index.items()})

    def close(self) -> None:
        """Write the open chunk and the summary, and close the file even if that fails. Again it does nothing."""
        if self._file.closed:
            return
        try:
            self.flush()
        finally:
            try:
                self._finish()
            finally:
                self._file.close()

    def _finish(self) -> None:
        end = _bytes_of(DataEnd(0))
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self.kept),
            chunk_count=len(self._chunks),
            message_count=self.kept.total(),
            message_end_time=self.end_ns,
            message_start_time=self.start_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        summary = _bytes_of(*self._schemas, *self._channels, statistics, *self._chunks, *self._metadata)
        start = self.size + len(end)
        checked = summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
        self._write(end + summary + _bytes_of(Footer(start, 0, zlib.crc32(checked))) + MAGIC)

    def _begin_chunk(self) -> None:
        self._packer = self._compressor.compressobj()
        self._packed: list[bytes] = []
        self._chunk_bytes: int = 0
        self._index: dict[int, list[tuple[int, int]]] = {}

    def _write(self, *parts: bytes) -> int:
        """Write all parts or nothing. Returns their offset."""
        at = self.size
        try:
            for part in parts:
                left = memoryview(part)
                while left:
                    left = left[self._file.write(left) :]
        except OSError:
            self._file.truncate(at)
            self._file.seek(at)
            raise
        self.size += sum(map(len, parts))
        return at


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap does not say what it returns
