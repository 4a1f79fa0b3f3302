"""What is told of paths that cannot be used."""

import errno
import os

import pytest

from spot3d.file_errors import in_words


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError("cannot listen at tcp/[::]:7447"), "cannot listen at tcp/[::]:7447"),
        (OSError(errno.EPERM, os.strerror(errno.EPERM)), "Operation not permitted"),
        (OSError(errno.EIO, os.strerror(errno.EIO), "/a/b"), "cannot use /a/b: Input/output error"),
        (
            OSError(errno.EROFS, os.strerror(errno.EROFS), "/a/b"),
            "cannot use /a/b: the file system is read-only; give another path",
        ),
        (
            OSError(errno.EACCES, os.strerror(errno.EACCES), "/a/b"),
            "cannot use /a/b: permission denied; give another path, or change its permissions",
        ),
    ],
)
def test_an_error_is_told_in_words(error: OSError, said: str) -> None:
    assert in_words(error) == said
