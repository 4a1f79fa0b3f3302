"""Messages for users whose path cannot be used."""

import errno

_WHY = {
    errno.ENOENT: "it, or the folder that it is in, does not exist; check the spelling, or create the folder",
    errno.EEXIST: "it is a file, but a folder is needed; give another path",
    errno.ENOTDIR: "a part of its path is a file, but must be a folder; give another path",
    errno.EISDIR: "it is a folder, but a file is needed; give the path of a file",
    errno.EACCES: "permission denied; give another path, or change its permissions",
    errno.EPERM: "permission denied; give another path, or change its permissions",
    errno.EROFS: "the file system is read-only; give another path",
    errno.ENOSPC: "the disk is full; free some space, or give another path",
}


def why(error: OSError) -> str:
    """What is wrong with the path that an error is about, and what to do."""
    return _WHY.get(error.errno or 0) or error.strerror or str(error)


def in_words(error: OSError) -> str:
    """One line for an OSError of the system or of our own, with its path if it has one."""
    if error.filename is None:
        return error.strerror or str(error)
    return f"cannot use {error.filename}: {why(error)}"
