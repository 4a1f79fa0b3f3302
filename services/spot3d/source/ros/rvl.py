"""RVL, lossless coding of depth by runs and differences (Wilson, Fast Lossless Depth Image Compression, ISS 2017).

An integer is a sequence of nibbles of three bits each, the lowest first. A nibble's highest bit says that another one
follows. Eight nibbles make a word of 32 bits, the first one highest. The pixels, row by row, are coded as a count of
zeros, a count of non-zero pixels, and for each of these the difference from the last non-zero pixel (0, -1, 1, -2, ...
as 0, 1, 2, 3, ...), and so on.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel, part
from spot3d.source.errors import SourceError
from spot3d_schemas.limits import MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE

_SIZE = struct.Struct("<II")
"""Header of ROS' compressed_depth_image_transport before the words: columns and rows."""
_NIBBLES_MOST = 10
"""Most nibbles of a number: 30 bits are more than the pixel count of any image, or a difference, needs."""


def decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """Decodes an RVL image after its size, as ROS sends it, to (h, w) uint16. Raises SourceError if it is damaged."""
    if len(data) < _SIZE.size:
        raise SourceError(f"a depth image in RVL has {len(data)} bytes, which is too few for its size")
    columns, rows = _SIZE.unpack_from(data)
    if not 0 < max(rows, columns) <= MAX_IMAGE_SIDE or not 0 < rows * columns <= MAX_IMAGE_PIXELS:
        raise SourceError(f"a depth image in RVL states a size of {columns}x{rows} pixels; is it damaged?")
    words = np.frombuffer(data, "<u4", (len(data) - _SIZE.size) // 4, _SIZE.size).astype(np.uint32)
    pixels = np.zeros(rows * columns, np.uint16)
    there = _decode(words, pixels)
    if there < len(pixels):
        raise SourceError(f"a depth image in RVL is damaged after pixel {there} of {columns}x{rows}")
    return pixels.reshape(rows, columns)


@part()
def _number(words: NDArray[np.uint32], at: int) -> tuple[int, int]:
    """The number that begins at nibble `at`, and the nibble after it. (0, -1) if the data end or it is too long."""
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
    """Decodes `words` (m,) into `pixels` (n,), all zero before. Returns how many pixels precede any damage.

    A run that is longer than the rest of the image is damage. Data after the last pixel are ignored.
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
