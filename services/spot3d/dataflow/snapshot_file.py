"""A file of named arrays and plain values that is written and read completely or not at all."""

import json
import os
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MAGIC = b"spot3d snapshot 2\n"
_LENGTH = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
_HEAD_MAX = 2**26
"""Longest description: 64 MB."""


class SnapshotError(ValueError):
    """A file is no usable snapshot; the message says which and why."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """kind: the stage. values: JSON-serialisable. arrays: by name."""

    kind: str
    values: dict[str, Any]
    arrays: Mapping[str, NDArray[Any]]


def snapshot_bytes(snapshot: Snapshot) -> list[bytes]:
    """The file's content in pieces, a copy: the snapshot's arrays may change afterwards."""
    described = [[name, array.dtype.str, list(array.shape)] for name, array in snapshot.arrays.items()]
    if any(array.dtype.hasobject or array.dtype.names for array in snapshot.arrays.values()):
        raise TypeError("only arrays of numbers can be saved")
    head = json.dumps({"kind": snapshot.kind, "values": snapshot.values, "arrays": described}, allow_nan=False).encode()
    return [_MAGIC, _LENGTH.pack(len(head)), head, *(array.tobytes() for array in snapshot.arrays.values())]


def write_snapshot(path: Path, pieces: list[bytes]) -> None:
    """Write the content from `snapshot_bytes`; readers find the previous file or this one. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f".{path.name}.*.partial"):
        left.unlink(missing_ok=True)  # of a process that was killed
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as stream:
            checksum = 0
            for piece in pieces:
                stream.write(piece)
                checksum = zlib.crc32(piece, checksum)
            stream.write(_CHECKSUM.pack(checksum))
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def read_snapshot(path: Path, kind: str) -> Snapshot:
    """The snapshot in a file. Raises SnapshotError if it is damaged or of another kind, and OSError."""
    data = path.read_bytes()
    if not data.startswith(_MAGIC):
        raise SnapshotError(f"{path} is not a snapshot of spot3d, or is one of another version")
    body, at = memoryview(data)[: -_CHECKSUM.size], len(_MAGIC) + _LENGTH.size
    if len(body) < at or zlib.crc32(body) != _CHECKSUM.unpack(data[-_CHECKSUM.size :])[0]:
        raise SnapshotError(f"{path} is damaged (wrong checksum) and is not used")
    (length,) = _LENGTH.unpack(body[len(_MAGIC) : at])
    try:
        if length > _HEAD_MAX:
            raise ValueError("the description is too long")
        head = json.loads(bytes(body[at : at + length]))
        arrays, at = {}, at + length
        for name, dtype, shape in head["arrays"]:
            count = int(np.prod(shape, dtype=np.int64))
            arrays[name] = np.frombuffer(body, np.dtype(dtype), count, at).reshape(shape).copy()
            at += arrays[name].nbytes
        snapshot = Snapshot(head["kind"], head["values"], arrays)
    except (ValueError, KeyError, TypeError) as error:
        raise SnapshotError(f"{path} cannot be read and is not used: {error}") from error
    if snapshot.kind != kind:
        raise SnapshotError(f"{path} is a snapshot of {snapshot.kind}, not of {kind}")
    return snapshot
