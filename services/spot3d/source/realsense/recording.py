"""A recording of the RealSense SDK (`.bag`, of newer versions `.db3`) as a stream of frames."""

import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path
from threading import Event

from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.realsense.framesets import sdk, streamed
from spot3d.source.sequence import Note

_TOPICS = "/device_0/"
"""How the SDK's recordings name their topics; no driver of ROS does."""
_LIST_BYTES = 2**20


def is_realsense_recording(path: Path) -> bool:
    """Whether a `.bag` or `.db3` file was written by the SDK, by its topics; False for what cannot be read."""
    if not path.is_file():
        return False
    if path.suffix == ".db3":
        try:
            connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
            try:
                found = connection.execute("SELECT 1 FROM topics WHERE name LIKE ?", (f"{_TOPICS}%",)).fetchone()
            finally:
                connection.close()
        except sqlite3.Error:
            return False
        return found is not None
    return path.suffix == ".bag" and f"topic={_TOPICS}".encode() in _list_of_topics(path)


def _list_of_topics(path: Path) -> bytes:
    """Where a ROS 1 bag lists its topics (format 2.0): behind its chunks, at the place that its header names."""
    with path.open("rb") as file:
        start = file.read(4096)
        at = start.find(b"index_pos=")
        if at < 0 or len(start) < at + 18:
            return b""
        place = struct.unpack_from("<Q", start, at + 10)[0]
        if place >= path.stat().st_size:  # damaged, and maybe more than a file can have
            return b""
        file.seek(place)
        return file.read(_LIST_BYTES)


class RealSenseRecording:
    """Frames of a recording at its own pace, as the camera gave them: the SDK's way of playing is that of a camera."""

    def __init__(self, path: Path) -> None:
        sdk()
        self._path = path

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """Frames until the file ends, or until `stop`. Raises SourceError for what cannot be played."""
        rs = sdk()
        try:
            playback = rs.context().load_device(str(self._path))
            yield from streamed(playback, stop, note, lambda: playback.current_status() == rs.playback_status.stopped)
        except (RuntimeError, ValueError) as error:
            raise SourceError(f"{self._path} cannot be played: {error}; does it hold depth and colour?") from error
