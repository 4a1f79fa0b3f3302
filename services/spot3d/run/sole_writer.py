"""One run at a time writes into a folder."""

import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spot3d.source.errors import SourceError

log = logging.getLogger(__name__)


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Make the folder, and lock it against other runs until the end, however this process ends.

    Raises SourceError if another run writes into it, and OSError if it cannot be made. A file system without locks
    keeps nobody out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        _lock(handle, folder)
        yield
    finally:
        os.close(handle)


def _lock(handle: int, folder: Path) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise SourceError(f"another run writes into {folder}; choose another folder with --out") from error
    except OSError as error:
        log.debug("%s cannot be locked: %s", folder, error)
