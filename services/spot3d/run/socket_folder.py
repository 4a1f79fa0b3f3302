"""The folder of the Unix socket where the stages of a run meet."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PREFIX = "spot3d-run-"
_SOCKET = "stages"
_PATH_BYTES = 103
"""Longest path of a Unix socket: its address has room for 104 bytes on macOS, and 108 on Linux, with a zero."""


@contextmanager
def stages_socket() -> Iterator[Path]:
    """Where to open the socket: in a new folder that only this user may enter, deleted at the end.

    A killed run leaves its folder behind, and the next run of this user deletes it: a folder is locked for as long as
    the process of its run lives.
    """
    place = _place()
    _delete_left_behind(place)
    folder = tempfile.TemporaryDirectory(prefix=_PREFIX, dir=place)
    handle = os.open(folder.name, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks: nobody can delete it later
            fcntl.flock(handle, fcntl.LOCK_EX)
        with folder as name:
            yield Path(name, _SOCKET)
    finally:
        os.close(handle)


def _place() -> Path:
    """The folder for temporary files; /tmp if its path is too long for that of a socket in it."""
    place = Path(tempfile.gettempdir())
    longest = place / f"{_PREFIX}{'x' * 8}" / _SOCKET  # as `tempfile` names folders
    return place if len(os.fsencode(longest)) <= _PATH_BYTES else Path("/tmp")


def _delete_left_behind(place: Path) -> None:
    for folder in place.glob(f"{_PREFIX}*"):
        with suppress(OSError):  # another user's, gone by now, or locked, since its run goes on
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                # Without a socket it may be one that is made just now, and not locked yet.
                if os.fstat(handle).st_uid == os.geteuid() and (folder / _SOCKET).exists():
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder)
            finally:
                os.close(handle)
