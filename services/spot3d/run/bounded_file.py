"""A file that grows line by line, up to a limit."""

from contextlib import suppress
from pathlib import Path


class BoundedFile:
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
