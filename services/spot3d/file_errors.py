"""Messages for users whose path cannot be used."""

import errno

_WHY = {
    errno.ENOENT: "it, or the folder that it is in, does not exist; look at how it is spelt, or make the folder",
    errno.EEXIST: "it is a file, and a folder is needed; give another path",
    errno.ENOTDIR: "a part of its path is a file, and a folder is needed; give another path",
    errno.EISDIR: "it is a folder, and a file is needed; give the path of a file",
    errno.EACCES: "you lack the permission; give another path, or change its permissions",
    errno.EPERM: "you lack the permission; give another path, or change its permissions",
    errno.EROFS: "its file system is read-only; give another path",
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
