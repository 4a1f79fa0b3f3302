"""Image files as arrays, with errors that say what is wrong with the file."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.source.errors import SourceError

COLOUR = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
"""How colour is decoded: as its pixels are stored. An EXIF orientation would turn colour, but not depth."""

_BEGIN, _END, _PROGRESSIVE, _GREY = b"\xff\xd8", b"\xff\xd9", b"\xff\xc2", 128
"""Marks of a JPEG's beginning, end, and frame of progressive scans; its mid-grey."""
_MORE = np.full(4096, 0x55, np.uint8)
"""Data of more pixels, whatever they show."""


def read_colour(path: Path) -> NDArray[np.uint8]:
    """Colour image (h, w, 3) uint8 RGB of a PNG or JPEG file. Raises SourceError if missing or unreadable."""
    return np.asarray(cv2.cvtColor(_image_of(path, COLOUR), cv2.COLOR_BGR2RGB), np.uint8)


def read_depth(path: Path) -> NDArray[np.uint16]:
    """Depth image (h, w) uint16 in the file's units. Raises SourceError unless it is 16-bit, one channel."""
    image = _image_of(path, cv2.IMREAD_UNCHANGED)
    if image.dtype == np.uint8:
        raise SourceError(f"{path} is 8-bit depth, which has only 256 levels; export depth as 16-bit PNG")
    if image.dtype != np.uint16 or image.ndim != 2:
        raise SourceError(f"{path} is {image.dtype} {image.shape}; depth must be a 16-bit PNG with one channel")
    return np.asarray(image, np.uint16)


def decoded_image(data: NDArray[np.uint8], how: int) -> NDArray[Any] | None:
    """Decodes the bytes (n,) of an image file. how: an OpenCV flag.

    None if they are no image, one far too large, or a JPEG that was cut short.
    """
    try:
        decoded = cv2.imdecode(data, how) if data.size else None
        image = None if decoded is None else np.asarray(decoded)
        return None if image is None or _is_cut_short(data, image, how) else image
    except cv2.error:
        return None


def _is_cut_short(data: NDArray[np.uint8], image: NDArray[Any], how: int) -> bool:
    """Whether the data are those of a JPEG and end before `image` does, though they have an end mark.

    The decoder fills what is missing of a sequential one with grey, and leaves a progressive one blurred. If such an
    image is whole, more data changes nothing.
    """
    if data[:2].tobytes() != _BEGIN:
        return False
    written = data.tobytes()
    if (image[-4:, -4:] != _GREY).any() and _PROGRESSIVE not in written:
        return False
    end = written.rfind(_END)
    longer = np.concatenate((data[:end], _MORE, data[end:]))
    return not np.array_equal(image, np.asarray(cv2.imdecode(longer, how)))


def _image_of(path: Path, how: int) -> NDArray[Any]:
    try:
        data = np.fromfile(path, np.uint8)
    except FileNotFoundError:
        raise SourceError(f"{path} is missing; is the recording complete?") from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in its name
        raise SourceError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if data.size == 0:
        raise SourceError(f"{path} is empty; copy or convert the recording again")
    image = decoded_image(data, how)
    if image is None:
        raise SourceError(f"{path} is not a readable image; copy or convert the recording again")
    return image
