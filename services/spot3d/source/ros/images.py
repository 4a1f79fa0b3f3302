"""Converts ROS image messages to arrays."""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.source.errors import SourceError
from spot3d.source.images import COLOUR, decoded_image

_CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1}
_DEPTH_TYPES = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
_DEPTH_HEADER = struct.Struct("<iff")
"""compressedDepth's header before the image: a number, and the two parameters of the inverse depth's quantisation."""
MILLIMETRES = 0.001
"""Metres per unit of 16UC1 (REP 118)."""


def colour_image(message: Any) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 RGB from an Image (rgb8, bgr8, rgba8, bgra8, mono8) or CompressedImage. Raises SourceError."""
    if not hasattr(message, "encoding"):
        return np.asarray(cv2.cvtColor(_unpacked(message, message.data, COLOUR), cv2.COLOR_BGR2RGB), np.uint8)
    encoding = message.encoding
    channels = _CHANNELS.get(encoding)
    if channels is None:
        raise SourceError(f"a colour image has the encoding {encoding!r}; supported are {', '.join(_CHANNELS)}")
    image = _rows(message, np.dtype(np.uint8), channels)
    if channels == 1:
        return np.repeat(image, 3, axis=2)
    return np.ascontiguousarray(image[..., 2::-1] if encoding.startswith("bgr") else image[..., :3])


def depth_image(message: Any) -> NDArray[np.uint16] | NDArray[np.float32]:
    """(h, w) uint16 millimetres or float32 metres, 0 = invalid, from a depth image message.

    It is an Image (16UC1, mono16, 32FC1), or a CompressedImage: 16-bit PNG, or the transport compressedDepth's coding
    of either (PNG or RVL). Raises SourceError.
    """
    if hasattr(message, "encoding"):
        dtype = _DEPTH_TYPES.get(message.encoding)
        if dtype is None:
            raise SourceError(
                f"a depth image has the encoding {message.encoding!r}; supported are {', '.join(_DEPTH_TYPES)}"
            )
        return _valid(_rows(message, np.dtype(dtype), 1)[..., 0])
    kind = message.format
    if "compressedDepth" not in kind:
        return _sixteen_bits(message, message.data)
    header, image = bytes(message.data[: _DEPTH_HEADER.size]), message.data[_DEPTH_HEADER.size :]
    if len(header) < _DEPTH_HEADER.size:
        raise SourceError(f"a depth image ({kind!r}) has {len(header)} bytes, too few for its header")
    _, a, b = _DEPTH_HEADER.unpack(header)
    steps = _of_rvl(image) if "rvl" in kind.lower() else _sixteen_bits(message, image)
    if not kind.startswith("32FC1"):
        return steps
    # Steps of inverse depth (compressed_depth_image_transport). 0 is invalid.
    metres = np.zeros(steps.shape, np.float32)
    np.divide(np.float32(a), steps - np.float32(b), out=metres, where=steps > 0)
    return _valid(metres)


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """(h, w, channels) pixels of an Image in native byte order. Padding at the end of its rows is removed."""
    height, width, step = message.height, message.width, message.step
    data, row = np.asarray(message.data, np.uint8), width * channels * dtype.itemsize
    if height < 1 or width < 1 or step < row or len(data) < step * (height - 1) + row:
        raise SourceError(
            f"an image of {width}x{height} {message.encoding} has {step} bytes per row and {len(data)} in total, "
            "which does not fit its size"
        )
    padded = np.zeros(step * height, np.uint8)
    padded[: len(data)] = data[: step * height]
    pixels = np.ascontiguousarray(padded.reshape(height, step)[:, :row])
    order = dtype.newbyteorder(">" if message.is_bigendian else "<")
    return pixels.view(order).astype(dtype, copy=False).reshape(height, width, channels)


def _unpacked(message: Any, data: NDArray[np.uint8], how: int) -> NDArray[Any]:
    image = decoded_image(np.asarray(data, np.uint8), how)
    if image is None:
        raise SourceError(
            f"a compressed image ({message.format!r}, {len(data)} bytes) cannot be decoded as PNG or JPEG"
        )
    return image


def _sixteen_bits(message: Any, data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    image = _unpacked(message, data, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise SourceError(f"compressed depth is {image.dtype} {image.shape}; expected one channel of 16 bits")
    return image


def _of_rvl(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    from spot3d.source.ros.rvl import decode_rvl  # numba takes a second to import

    return decode_rvl(bytes(data))


def _valid(depth: NDArray[Any]) -> NDArray[Any]:
    """Sets depth that is NaN, infinite or negative to 0."""
    if depth.dtype == np.float32:
        depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))
    return np.ascontiguousarray(depth)
