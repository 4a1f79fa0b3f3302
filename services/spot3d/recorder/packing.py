"""The process that compresses and writes a recording, so that the recorder is free to receive messages.

    python -m spot3d.recorder.packing WIRE MEMORY OUT.mcap live|lossless

WIRE: descriptor of a socket with orders and answers, each an array in msgpack. MEMORY: descriptor of a file in memory
that holds the messages. The file is finished whenever the socket closes.
"""

import json
import mmap
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgpack

import spot3d
from spot3d.dataflow.process_use import run_when_idle
from spot3d.recorder.mcap_writer import McapWriter
from spot3d.recorder.profile import PROFILE

FLUSH_S = 1.0
"""Longest time that a compressed message waits before it is written."""


class _Packing:
    """Executes the orders from the wire. After the first failed write it ignores all but the last one."""

    def __init__(self, wire: Connection, memory: memoryview, path: Path) -> None:
        """Create a new file. Raises OSError if that fails."""
        self._wire, self._memory = wire, memory
        self._writer = McapWriter(path, PROFILE, f"spot3d {spot3d.__version__}")
        self._places: list[tuple[int, int, str]] = []
        self._flushed_s = time.monotonic()
        self._failed = self._over = False
        self._tell("began")

    def follow(self) -> None:
        """Execute orders up to the last one, or until the recorder is gone."""
        while not self._over:
            self._try(self._obey)

    def close(self) -> None:
        """Write the open chunk and the summary, and report it."""
        self._try(self._writer.close)
        self._tell_written()
        self._tell("ended")

    def _try(self, work: Callable[[], None]) -> None:
        try:
            work()
        except OSError as error:
            self._failed = True
            self._tell("failed", error.strerror or str(error))

    def _obey(self) -> None:
        """Execute the next order, or write the open chunk if none comes in time."""
        left_s = self._flushed_s + FLUSH_S - time.monotonic()
        if not self._failed and (left_s <= 0 or not self._wire.poll(left_s)):
            self._flush()
            return
        try:
            what, *values = msgpack.unpackb(self._wire.recv_bytes(), use_list=False)
        except (EOFError, OSError):  # perhaps in the middle of an order
            what, values = "finish", ["", {}]
        if what == "finish":
            self._over = True
            self._finish(*values)
        elif not self._failed:
            {"add": self._add, "channel": self._channel, "metadata": self._writer.metadata}[what](*values)

    def _channel(self, *spec: Any) -> None:
        self._writer.channel(*spec)

    def _add(self, channel: int, log_ns: int, publish_ns: int, sequence: int, at: int, size: int, place: Any) -> None:
        if place is not None:
            self._places.append((self._writer.chunks, *place))
        before = self._writer.chunks
        self._writer.add(channel, log_ns, publish_ns, sequence, self._memory[at : at + size])
        self._tell("done")
        if self._writer.chunks > before:
            self._tell_written()

    def _flush(self) -> None:
        self._flushed_s = time.monotonic()
        self._writer.flush()
        self._tell_written()

    def _finish(self, frames: str, skipped: dict[str, str]) -> None:
        self._writer.flush()
        kept = [place for place in self._places if place[0] < self._writer.chunks]
        self._writer.metadata("frames", {"topic": frames, "chunk_stamp_ns_stream": json.dumps(kept)})
        self._writer.metadata("skipped", skipped)

    def _tell_written(self) -> None:
        writer = self._writer
        self._tell("written", dict(writer.kept), writer.size, writer.start_ns, writer.end_ns)

    def _tell(self, *words: object) -> None:
        _tell(self._wire, *words)


def _tell(wire: Connection, *words: object) -> None:
    with suppress(ConnectionError):  # the recorder is gone; what it received is written all the same
        wire.send_bytes(msgpack.packb(words))


def main(wire: Connection, memory: int, path: Path, delivery: str) -> None:
    """Compress and write until told to end."""
    # It ends with the recorder, which gets the same signals.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    if delivery == "live":
        run_when_idle()
    try:
        packing = _Packing(wire, memoryview(mmap.mmap(memory, 0)), path)
    except OSError as error:
        _tell(wire, "refused", error.errno or 0, error.strerror or str(error))
        return
    packing.follow()
    packing.close()


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])), int(sys.argv[2]), Path(os.fsdecode(sys.argv[3])), sys.argv[4])
