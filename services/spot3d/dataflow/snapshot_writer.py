"""Writes a stage's snapshots beside its work, one at a time, into the robot's folder."""

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.snapshot_file import write_snapshot
from spot3d.dataflow.stopping import end_threads
from spot3d.file_errors import why

_PATIENCE_S = 60.0
"""Time to the next attempt after a failure to write: a read-only folder mostly stays so."""


def snapshot_path(link: LinkSettings, stage: str) -> Path:
    """The file in which a stage of this robot keeps its snapshot."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    folder = Path(link.snapshot_folder) if link.snapshot_folder else Path(state) / "spot3d"
    return folder / link.robot / f"{stage}.snapshot"


class SnapshotWriter:
    """Writes a stage's snapshot at intervals; a failure is reported, and writing is tried again later.

    failed: called with the reason for a failure.
    """

    def __init__(self, path: Path, interval_s: float, failed: Callable[[str], None]) -> None:
        self.path = path
        self._interval_s = interval_s
        self._failed = failed
        self._last_s = float("-inf")
        self._thread: threading.Thread | None = None
        self._wanted: list[bytes] | None = None
        self._placing = threading.Lock()

    def due(self, now_s: float) -> bool:
        """Whether the next snapshot is due, monotonic seconds; never while one is being written, or with interval 0."""
        busy = self._thread is not None and self._thread.is_alive()
        return self._interval_s > 0 and not busy and now_s - self._last_s >= self._interval_s

    def write(self, pieces: list[bytes], last: bool = False, written: Callable[[], None] = lambda: None) -> None:
        """Begin to write the content of a file (see `snapshot_bytes`), unless the one before takes too long.

        last: write it before this returns. written: called once the file is there.
        """
        if self._busy_for_long():
            return
        self._wanted = pieces
        if last:
            self._write(pieces, written)
            return
        self._last_s = time.monotonic()
        self._thread = threading.Thread(target=self._write, args=(pieces, written), name="snapshot", daemon=True)
        self._thread.start()

    def forget(self) -> None:
        """Delete the file; one that is being written now is deleted once it is there."""
        with self._placing:
            self._wanted = None
            self._delete()

    def close(self) -> None:
        """Wait for the file that is being written."""
        if self._thread is not None:
            end_threads((self._thread,))

    def _busy_for_long(self) -> bool:
        """Wait for the file that is being written: two writers would use the same file."""
        self.close()
        busy = self._thread is not None and self._thread.is_alive()
        if busy:
            self._failed("the previous snapshot is still being written; a restart would lose what came since")
        return busy

    def _write(self, pieces: list[bytes], written: Callable[[], None]) -> None:
        try:
            write_snapshot(self.path, pieces)
        except OSError as error:
            self._last_s = time.monotonic() + _PATIENCE_S - self._interval_s
            self._failed(
                f"cannot write a snapshot to {self.path.parent}: {error.strerror or error}; a restart would begin "
                "with an empty map"
            )
            return
        with self._placing:
            if self._wanted is pieces:
                written()
            else:
                self._delete()

    def _delete(self) -> None:
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            self._failed(f"cannot delete {self.path}: {why(error)}; a restart would resume from the deleted map")
