"""A lossless code for images of few distinct values: depth in a sensor's own steps, heat in a few levels.

Neighbours mostly have the same value or the next one, however far apart the values are: the rank of a pixel's value
among those of the image costs about two bits, its difference in millimetres four.

One deflate stream (zlib) holds, one after the other, integers little endian:

    uint32 n, uint32 m
    the n distinct values, ascending, as unsigned integers of the array's size: differences to the one before
    mask (`palette` only): a bit a pixel, rows padded to whole bytes, set where the value is not the lowest one
    the steps: four bits each, high ones first, 15 = an escape; an odd number is padded with 0
    m uint16: each escape's step less 15, first the low bytes, then the high ones

`palette`: the pixels in the mask, row after row, each one's rank less that of the one before (the first: less 0).
`palette-2d`: all pixels, each one's rank less its left and its upper one's, plus the upper left one's (0 outside).
Both modulo 2^16 and zigzag-mapped (0, -1, 1, -2 .. become 0, 1, 2, 3 ..). A hole of depth costs nothing in the first;
a heatmap, a sum of rectangles, changes at their corners only in the second.
"""

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_VALUES = 2**15
"""Most distinct values of an image: half of 16 bits, so that a difference keeps its sign."""

_HEAD = struct.Struct("<II")
_ESCAPE = 15


class ManyValuesError(ValueError):
    """The image has more distinct values than the code takes."""


def palette_encode(image: NDArray[Any], plane: bool) -> bytes:
    """Code of an (h, w) image of 1-, 2- or 4-byte values; plane: as `palette-2d`. Raises ManyValuesError."""
    bits = image.view(f"<u{image.itemsize}")
    values, ranks = _ranked(bits)
    if plane:
        steps = np.diff(np.diff(ranks, axis=0, prepend=np.uint16(0)), axis=1, prepend=np.uint16(0)).ravel()
        mask = b""
    else:
        inside = ranks > 0
        steps = np.diff(ranks[inside], prepend=np.uint16(0))
        mask = np.packbits(inside, axis=1).tobytes()
    signed = steps.view(np.int16)
    zigzag = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    escapes = zigzag[zigzag >= _ESCAPE] - np.uint16(_ESCAPE)
    small = np.zeros((len(zigzag) + 1) // 2 * 2, np.uint8)
    np.minimum(zigzag, _ESCAPE, out=small[: len(zigzag)], casting="unsafe")
    parts = (
        _HEAD.pack(len(values), len(escapes)) + np.diff(values, prepend=values[:1] * 0).tobytes(),
        mask,
        (small[::2] << 4 | small[1::2]).tobytes(),
        escapes.astype("<u2").view(np.uint8).reshape(-1, 2).T.tobytes(),
    )
    deflate = zlib.compressobj(1, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    # Flushed between them, each part has Huffman codes of its own.
    coded = [deflate.compress(part) + deflate.flush(zlib.Z_BLOCK) for part in parts if part]
    return b"".join(coded) + deflate.flush()


def palette_decode(data: memoryview, dtype: np.dtype[Any], shape: tuple[int, ...], plane: bool) -> NDArray[Any]:
    """Inverse of `palette_encode`: an (h, w) array of `dtype`, little endian. Raises ValueError."""
    height, width = shape
    pixels, row = height * width, 0 if plane else (width + 7) // 8
    most = _HEAD.size + min(pixels, MOST_VALUES) * dtype.itemsize + height * row + (pixels + 1) // 2 + 2 * pixels
    inflate = zlib.decompressobj()
    try:
        stream = memoryview(inflate.decompress(data, most + 1))
    except zlib.error as error:
        raise ValueError(f"the deflated data is damaged ({error})") from None
    if not inflate.eof or not _HEAD.size <= len(stream) <= most:
        raise ValueError(f"the deflated data is not an image of shape {list(shape)}")
    count, escaped = _HEAD.unpack_from(stream)
    ends = np.cumsum((_HEAD.size, count * dtype.itemsize, height * row))
    inside = None
    if 0 < count <= MOST_VALUES and ends[-1] <= len(stream):
        packed = np.frombuffer(stream[ends[1] : ends[2]], np.uint8).reshape(height, row)
        inside = np.unpackbits(packed, axis=1, count=width).view(np.bool_) if row else np.ones(shape, np.bool_)
    coded = 0 if inside is None else int(np.count_nonzero(inside))
    small_end = int(ends[-1]) + (coded + 1) // 2
    if inside is None or len(stream) != small_end + 2 * escaped:
        raise ValueError(f"the parts of the palette do not form an image of shape {list(shape)}")
    differences = np.frombuffer(stream[ends[0] : ends[1]], f"<u{dtype.itemsize}")
    values = np.add.accumulate(differences, dtype=differences.dtype)
    steps = _steps(stream[ends[2] : small_end], stream[small_end:], coded)
    if plane:
        ranks = steps.reshape(shape)
        np.add.accumulate(ranks, axis=0, dtype=np.uint16, out=ranks)
        np.add.accumulate(ranks, axis=1, dtype=np.uint16, out=ranks)
    else:
        ranks = np.zeros(shape, np.uint16)
        ranks[inside] = np.add.accumulate(steps, dtype=np.uint16, out=steps)
    if ranks.max() >= count:
        raise ValueError(f"the palette has {count} values, but a pixel refers to value {ranks.max()}")
    image: NDArray[Any] = values[ranks].view(dtype)
    return image


def _ranked(bits: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint16]]:
    """The ascending distinct values of an image of unsigned integers, and each pixel's place among them."""
    if bits.itemsize > 2:
        values, places = np.unique(bits, return_inverse=True)
        places = places.reshape(bits.shape)
    else:
        there = np.bincount(bits.ravel(), minlength=1) > 0
        values = np.flatnonzero(there).astype(bits.dtype)
        places = (np.cumsum(there) - 1)[bits]
    if len(values) > MOST_VALUES:
        raise ManyValuesError(f"{len(values)} distinct values; at most {MOST_VALUES} are possible")
    return values, places.astype(np.uint16)


def _steps(small: memoryview, escapes: memoryview, count: int) -> NDArray[np.uint16]:
    """(count,) the steps, modulo 2^16. Raises ValueError if the number of escapes is not that in the steps."""
    packed = np.frombuffer(small, np.uint8)
    zigzag = np.empty(2 * len(packed), np.uint16)
    zigzag[::2], zigzag[1::2] = packed >> 4, packed & 15
    zigzag = zigzag[:count]
    escaped = zigzag == _ESCAPE
    low, high = np.frombuffer(escapes, np.uint8).reshape(2, -1).astype(np.uint16)
    if np.count_nonzero(escaped) != len(low):
        raise ValueError(f"the data has {len(low)} escapes, but its steps refer to {np.count_nonzero(escaped)}")
    zigzag[escaped] += low | high << 8
    sign = zigzag & 1
    np.negative(sign, out=sign)
    zigzag >>= 1
    zigzag ^= sign
    return zigzag
