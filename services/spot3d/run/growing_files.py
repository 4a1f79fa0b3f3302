"""Files that grow line by line during a run: the camera's trajectory, and the updates of the objects."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spot3d.run.results import RunResult, objects_document
from spot3d.trajectory import tum_line

TRAJECTORY, UPDATES = "trajectory.txt", "objects.jsonl"
LIMIT_BYTES = 256 * 2**20
"""Maximum size of each file: a day of poses at 30 frames a second, hours of a table with a dozen objects."""


class GrowingFiles:
    """A folder's trajectory.txt, the trusted poses in TUM format, and objects.jsonl, one line per update.

    Use it in a `with` block, or close it. Raises OSError where they cannot be made.
    """

    def __init__(self, folder: Path, limit_bytes: int = LIMIT_BYTES) -> None:
        self.folder = folder
        self._poses = _BoundedFile(folder / TRAJECTORY, limit_bytes, "poses")
        self._updates = _BoundedFile(folder / UPDATES, limit_bytes, "updates")
        self._last_ns: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close both files."""
        self._poses.close()
        self._updates.close()

    def leave(self, folder: Path) -> None:
        """Move the files into another folder and begin new ones, whose stamps may be anything. Raises OSError."""
        self._last_ns = None
        self._poses.leave(folder)
        self._updates.leave(folder)

    def add_pose(self, stamp_ns: int, T_world_camera: NDArray[np.float64]) -> None:
        """Add a frame's pose, (4, 4); one that is not later than the last is left out: readers rely on the order."""
        if self._last_ns is None or stamp_ns > self._last_ns:
            self._last_ns = stamp_ns
            self._poses.add(tum_line(stamp_ns, T_world_camera))

    def add_update(self, stamp_ns: int, found: RunResult, complete: bool) -> None:
        """Add an update: the objects after the frame of this stamp. complete: those of all frames."""
        self._updates.add(json.dumps({"stamp_ns": stamp_ns, "complete": complete, **objects_document(found)}))

    def notices(self) -> list[str]:
        """Messages for people about missing lines."""
        return [text for file in (self._updates, self._poses) if (text := file.notice())]


class _BoundedFile:
    """Appends lines until it is closed. Lines that cannot be kept are counted, and end nothing.

    what: what the missing lines hold, in words.
    """

    def __init__(self, path: Path, limit_bytes: int, what: str) -> None:
        self._missing = 0
        self._path, self._limit, self._what = path, limit_bytes, what
        self._stream = path.open("wb", buffering=0)
        self._bytes = 0
        self._reason = ""

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def leave(self, folder: Path) -> None:
        """Move the file into another folder and begin a new one. Raises OSError."""
        self._stream.close()
        try:
            self._path.replace(folder / self._path.name)
            self._missing, self._reason = 0, ""
        finally:
            self._stream = self._path.open("ab", buffering=0)
            self._bytes = self._stream.tell()

    def add(self, text: str) -> None:
        """Append one line, without its end."""
        line = text.encode() + b"\n"
        if not self._reason and self._bytes + len(line) > self._limit:
            self._reason = f"has reached its limit of {self._limit} bytes"
        if not self._reason:
            try:
                written = self._stream.write(line)
                if written < len(line):
                    raise OSError(None, "the disk is full")
                self._bytes += len(line)
                return
            except OSError as error:
                with suppress(OSError):  # leave no half line behind, if the disk is still there
                    self._stream.truncate(self._bytes)
                self._reason = f"cannot be written: {error.strerror}"
        self._missing += 1

    def notice(self) -> str | None:
        """A message for people if lines are missing."""
        return f"{self._path.name} {self._reason}; {self._missing} {self._what} are missing" if self._missing else None
