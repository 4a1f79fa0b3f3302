"""objects.jsonl: how the objects of a run came to be, one line an update."""

import json
from pathlib import Path
from typing import Self

from spot3d.run.results import RunResult, objects_document

NAME = "objects.jsonl"
LIMIT_BYTES = 256 * 2**20
"""Longest file: hours of a table with a dozen objects."""


class Timeline:
    """Appends to the file; use it in a `with` block. What it cannot keep is counted, and ends no run."""

    def __init__(self, path: Path, limit_bytes: int = LIMIT_BYTES) -> None:
        self.missing = 0
        self._path, self._limit = path, limit_bytes
        self._stream = path.open("wb", buffering=0)
        self._bytes = 0
        self._reason = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def add(self, stamp_ns: int, found: RunResult, complete: bool) -> None:
        """One update: the objects after the frame of this stamp. complete: those of all frames."""
        line = json.dumps({"stamp_ns": stamp_ns, "complete": complete, **objects_document(found)}).encode() + b"\n"
        if not self._reason and self._bytes + len(line) > self._limit:
            self._reason = f"is at its limit of {self._limit} bytes"
        if not self._reason:
            try:
                written = self._stream.write(line)
                if written < len(line):
                    raise OSError(None, "the disk is full")
                self._bytes += len(line)
                return
            except OSError as error:
                # No half line is left behind.
                self._stream.truncate(self._bytes)
                self._reason = f"cannot be written: {error.strerror}"
        self.missing += 1

    def told(self) -> str | None:
        """What to tell people where updates are missing."""
        return f"{self._path.name} {self._reason}: it lacks {self.missing} updates" if self.missing else None
