"""Reads the recordings' text files: matrices, lists of stamped lines, poses."""

import logging
import math
import re
from collections.abc import Callable, Collection
from decimal import Decimal
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from spot3d.file_errors import why
from spot3d.source.errors import SourceError
from spot3d.trajectory import nearest_rotation, pose_from_quaternion

log = logging.getLogger(__name__)

E = TypeVar("E")
T = TypeVar("T")

# Rotations written with a handful of digits are orthonormal within about this tolerance.
_ROTATION_TOLERANCE = 1e-2
_POSE_LINE = "expected `timestamp tx ty tz qx qy qz qw`: seconds, metres and a unit quaternion"
_STAMP_MAX_NS = np.iinfo(np.int64).max


def read_text(path: Path) -> str:
    """The file's text. Raises SourceError if it is missing or not UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SourceError(f"{path} is missing; is the recording complete?") from None
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {why(error)}") from error
    except UnicodeDecodeError as error:
        raise SourceError(f"{path} is not a text file in UTF-8: {error}; save it as UTF-8") from error


def numbers_of(text: str, path: Path, expected: str) -> NDArray[np.float64]:
    """A file's numbers (n,), between spaces, commas or brackets. Raises SourceError, which says what is expected."""
    try:
        return np.array([float(word) for word in re.sub(r"[\[\],]", " ", text).split()])
    except ValueError:
        raise SourceError(f"{path} is malformed: it contains text that is not a number; {expected}") from None


def read_pose_matrix(path: Path) -> NDArray[np.float64] | None:
    """T_world_camera (4, 4) float64, or None where the recorder had lost track (written as nan or inf).

    A rotation that was written with few digits is made orthonormal, as messages require. Raises SourceError if the
    matrix is no rigid transform.
    """
    values = numbers_of(read_text(path), path, "expected 4x4 numbers")
    if values.size != 16:
        raise SourceError(f"{path} is malformed: it has {values.size} numbers; expected 4x4")
    T_world_camera = values.reshape(4, 4)
    if not np.isfinite(T_world_camera).all():
        return None
    if not is_rigid(T_world_camera):
        raise SourceError(f"{path} is malformed: expected a rigid 4x4 transform, camera to world, in metres")
    T_world_camera[:3, :3] = nearest_rotation(T_world_camera[:3, :3])
    T_world_camera[3] = (0, 0, 0, 1)
    return T_world_camera


def is_rigid(T: NDArray[np.float64]) -> bool:
    """Whether a (4, 4) matrix is a rotation, up to rounding, and a translation."""
    rotation = T[:3, :3]
    turns = np.isfinite(T).all() and np.allclose(rotation @ rotation.T, np.eye(3), atol=_ROTATION_TOLERANCE)
    return bool(turns and np.linalg.det(rotation) > 0 and np.allclose(T[3], [0, 0, 0, 1]))


def pose_of_words(words: list[str], where: str) -> NDArray[np.float64]:
    """T_world_camera (4, 4) float64 from TUM's `tx ty tz qx qy qz qw`. `where` names the line in errors.

    Raises SourceError unless there are seven finite numbers with a quaternion of unit length.
    """
    for word in words:
        if not _is_finite(word):
            raise SourceError(f"{where} is malformed: {word!r} is not a finite number; {_POSE_LINE}")
    if len(words) != 7:
        raise SourceError(f"{where} is malformed: it has {1 + len(words)} numbers; {_POSE_LINE}")
    values = np.array([float(word) for word in words])
    length = float(np.linalg.norm(values[3:]))
    if abs(length - 1) > _ROTATION_TOLERANCE:
        raise SourceError(f"{where} is malformed: the quaternion's length is {length:.3f}, not 1; {_POSE_LINE}")
    return pose_from_quaternion(values[:3], values[3:])


def read_stamped_lines(path: Path, parse: Callable[[list[str], str], T]) -> list[tuple[int, T]]:
    """Lines `stamp word...` as (stamp in ns, parsed words), sorted by stamp. `#` starts a comment.

    Stamps are seconds in the file, read exactly. parse: is given the words, and `file:line` for its SourceError.
    Malformed lines are skipped and logged. Raises SourceError if all are.
    """

    def read(numbered: tuple[str, list[str]]) -> tuple[int, T]:
        where, words = numbered
        return _stamp_ns(words, where), parse(words[1:], where)

    lines = (line.split("#")[0].replace(",", " ").split() for line in read_text(path).splitlines())
    numbered = [(f"{path}:{number}", words) for number, words in enumerate(lines, start=1) if words]
    return sorted(well_formed(numbered, read, f"lines of {path}"), key=lambda entry: entry[0])


def well_formed(entries: Collection[E], read: Callable[[E], T], what: str) -> list[T]:
    """What `read` returns for each entry, except those that it refuses, whose number is logged.

    read: raises SourceError or ValueError for a malformed entry. what: names the entries in the log. Raises the first
    error if all entries are malformed.
    """
    found: list[T] = []
    malformed: list[Exception] = []
    for entry in entries:
        try:
            found.append(read(entry))
        except (SourceError, ValueError) as error:
            malformed.append(error)
    if malformed and not found:
        raise malformed[0]
    if malformed:
        log.warning("%d of %d %s are left out; the first: %s", len(malformed), len(entries), what, malformed[0])
    return found


def _stamp_ns(words: list[str], where: str) -> int:
    try:
        stamp_ns = Decimal(words[0]) * 10**9
        in_range = abs(stamp_ns) <= _STAMP_MAX_NS
    except ArithmeticError:  # no number, or nan
        in_range = False
    if not in_range:
        unit = "; is it in another unit, such as nanoseconds?" if _is_finite(words[0]) else ""
        raise SourceError(
            f"{where} is malformed: it must begin with a timestamp in seconds, not with {words[0]!r}{unit}"
        )
    if len(words) < 2:
        raise SourceError(f"{where} is malformed: nothing follows the timestamp")
    return int(stamp_ns)


def _is_finite(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
