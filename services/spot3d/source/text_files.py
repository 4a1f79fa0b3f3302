"""The recordings' text files: matrices, lists of stamped lines, poses."""

from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.file_errors import why
from spot3d.source.errors import SourceError
from spot3d.trajectory import pose_from_quaternion

# A rotation written with a handful of digits is orthonormal to about this much.
ROTATION_TOLERANCE = 1e-2


def read_text(path: Path) -> str:
    """The file's text. Raises SourceError if it is missing or no text."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SourceError(f"{path} is missing; is the recording complete?") from None
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {why(error)}") from error
    except UnicodeDecodeError as error:
        raise SourceError(f"{path} cannot be read as text: {error}") from error


def read_matrix(path: Path, size: int) -> NDArray[np.float64]:
    """Matrix (size, size) float64 of a text file. Raises SourceError if it holds anything else."""
    words = read_text(path).split()
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        raise SourceError(f"{path} is malformed: not only numbers; expected {size}x{size} numbers") from None
    if values.size != size * size:
        raise SourceError(f"{path} is malformed: {values.size} numbers, expected {size}x{size}")
    return values.reshape(size, size)


def read_pose_matrix(path: Path) -> NDArray[np.float64] | None:
    """T_world_camera (4, 4) float64, or None where the recorder had lost track (written as nan or inf).

    Raises SourceError if the matrix is no rigid transform.
    """
    T_world_camera = read_matrix(path, 4)
    if not np.isfinite(T_world_camera).all():
        return None
    rotation = T_world_camera[:3, :3]
    rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=ROTATION_TOLERANCE)
    if not (rigid and np.linalg.det(rotation) > 0 and np.allclose(T_world_camera[3], [0, 0, 0, 1])):
        raise SourceError(f"{path} is malformed: not a camera-to-world rotation and translation")
    return T_world_camera


def pose_of_words(words: list[str], where: str) -> NDArray[np.float64]:
    """T_world_camera (4, 4) float64 of TUM's `tx ty tz qx qy qz qw`; `where` names the line in errors.

    Raises SourceError unless there are seven finite numbers with a quaternion of unit length.
    """
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        raise SourceError(f"{where} is malformed: not only numbers") from None
    if values.size != 7 or not np.isfinite(values).all():
        raise SourceError(f"{where} is malformed: expected `stamp tx ty tz qx qy qz qw`")
    length = float(np.linalg.norm(values[3:]))
    if abs(length - 1) > ROTATION_TOLERANCE:
        raise SourceError(f"{where} is malformed: the quaternion's length is {length:.3f}, not 1")
    return pose_from_quaternion(values[:3], values[3:])


def read_stamped_lines(path: Path) -> list[tuple[int, list[str], str]]:
    """Lines `stamp word...` as (stamp in ns, words, `file:line`), in order of stamps; `#` starts a comment.

    Stamps are seconds in the file, read exactly. Raises SourceError for a line without stamp and word.
    """
    lines = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        where = f"{path}:{number}"
        try:
            stamp_ns = int(Decimal(words[0]) * 10**9)
        except (InvalidOperation, ValueError, OverflowError):
            raise SourceError(f"{where} is malformed: {words[0]!r} is no time in seconds") from None
        if len(words) < 2:
            raise SourceError(f"{where} is malformed: nothing follows the time")
        lines.append((stamp_ns, words[1:], where))
    return sorted(lines, key=lambda entry: entry[0])
