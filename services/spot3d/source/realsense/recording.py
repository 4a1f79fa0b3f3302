"""A recording of the RealSense SDK (`.bag`, in newer versions `.db3`) as a stream of frames."""

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from threading import Event

from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.realsense.framesets import sdk, streamed
from spot3d.source.sequence import Note

_TOPICS = "/device_0/"
"""Topic prefix in the SDK's recordings. No ROS driver uses it."""
_LIST_BYTES = 2**20


def is_realsense_recording(path: Path) -> bool:
    """Whether a `.bag` or `.db3` file has the SDK's topics. False if it cannot be read."""
    if not path.is_file():
        return False
    if path.suffix == ".db3":
        uri, asked = f"{path.resolve().as_uri()}?mode=ro", "SELECT 1 FROM topics WHERE name LIKE ?"
        with suppress(sqlite3.Error), closing(sqlite3.connect(uri, uri=True)) as connection:
            return connection.execute(asked, (f"{_TOPICS}%",)).fetchone() is not None
        return False
    return path.suffix == ".bag" and f"topic={_TOPICS}".encode() in _list_of_topics(path)


def _list_of_topics(path: Path) -> bytes:
    """A ROS 1 bag's (format 2.0) list of topics, which stands behind the chunks at the offset named in its header."""
    with path.open("rb") as file:
        start = file.read(4096)
        at = start.find(b"index_pos=")
        if at < 0 or len(start) < at + 18:
            return b""
        place = struct.unpack_from("<Q", start, at + 10)[0]
        if place >= path.stat().st_size:  # damaged; the offset may exceed any file's size
            return b""
        file.seek(place)
        return file.read(_LIST_BYTES)


class RealSenseRecording:
    """Frames of a recording at its own pace. The SDK plays a recording like a live camera."""

    def __init__(self, path: Path) -> None:
        sdk()
        self._path = path

    def stream(self, stop: Event, note: Note) -> Iterator[RgbdFrame | None]:
        """Frames until the file ends or `stop` is set. Raises SourceError if it cannot be played."""
        rs = sdk()
        try:
            playback = rs.context().load_device(str(self._path))
            yield from streamed(playback, stop, note, lambda: playback.current_status() == rs.playback_status.stopped)
        except (RuntimeError, ValueError) as error:
            raise SourceError(f"{self._path} cannot be played: {error}; does it contain depth and colour?") from error
