"""Files that exist completely or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from spot3d.file_errors import why


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """A file that gets its name only once it is complete, so that no reader meets half a result.

    Raises OSError, with the file and the reason, if it cannot be written; an earlier file of that name stays.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as stream:
            yield stream
        partial.replace(path)
    except OSError as error:
        raise OSError(f"cannot write {path}: {why(error)}") from error
    finally:
        partial.unlink(missing_ok=True)
