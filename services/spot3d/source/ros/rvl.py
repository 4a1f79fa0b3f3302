"""RVL, lossless coding of depth by runs and differences (Wilson, Fast Lossless Depth Image Compression, ISS 2017).

Whole numbers are written three bits a nibble, the lowest first; a nibble's highest bit says that another one follows.
Eight nibbles make a word of 32 bits, the first one highest. The pixels, row by row, are a number of zeros, a number of
others, and the difference of each of these from the last that was not zero (0, -1, 1, -2, ... as 0, 1, 2, 3, ...), and
so on.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.source.errors import SourceError
from spot3d_schemas.limits import MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE

_SIZE = struct.Struct("<II")
"""What ROS' compressed_depth_image_transport puts before the words: columns and rows."""
_NIBBLES_MOST = 10
"""Of one number: 30 bits, more than the pixels of any image, or a difference, need."""


def decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """(h, w) uint16 of an image in RVL behind its size, as ROS sends it. Raises SourceError where that is damaged."""
    if len(data) < _SIZE.size:
        raise SourceError(f"a depth image in RVL has {len(data)} bytes, too few for its size")
    columns, rows = _SIZE.unpack_from(data)
    if not 0 < max(rows, columns) <= MAX_IMAGE_SIDE or not 0 < rows * columns <= MAX_IMAGE_PIXELS:
        raise SourceError(f"a depth image in RVL says that it is {columns}x{rows}; is it damaged?")
    words = np.frombuffer(data, "<u4", (len(data) - _SIZE.size) // 4, _SIZE.size).astype(np.uint32)
    pixels = np.zeros(rows * columns, np.uint16)
    there = _decode(words, pixels)
    if there < len(pixels):
        raise SourceError(f"a depth image in RVL is damaged behind pixel {there} of {columns}x{rows}")
    return pixels.reshape(rows, columns)


@part()
def _number(words: NDArray[np.uint32], at: int) -> tuple[int, int]:
    """The number that begins at a nibble, and the nibble behind it; -1 where the data end or the number does not."""
    value = 0
    for place in range(_NIBBLES_MOST):
        if at >= 8 * len(words):
            break
        nibble = int(np.int64(words[at >> 3]) >> (28 - 4 * (at & 7)) & 15)
        value |= (nibble & 7) << (3 * place)
        at += 1
        if nibble < 8:
            return value, at
    return 0, -1


@kernel()
def _decode(words: NDArray[np.uint32], pixels: NDArray[np.uint16]) -> int:
    """Writes `pixels` (n,), all zero before, of `words` (m,); returns how many there are before the data are damaged.

    A run that is longer than what is left of the image is damage. What may follow the last pixel is not looked at.
    """
    at = done = value = 0
    while done < len(pixels):
        zeros, at = _number(words, at)
        if at < 0 or zeros > len(pixels) - done:
            break
        done += zeros
        others, at = _number(words, at)
        if at < 0 or others > len(pixels) - done:
            break
        for _ in range(others):
            coded, at = _number(words, at)
            if at < 0:
                return done
            value = (value + ((coded >> 1) ^ -(coded & 1))) & 0xFFFF
            pixels[done] = value
            done += 1
    return done
