"""Arrays on the wire, {dtype, shape, encoding, data}, and what each array field of a message may hold."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from spot3d_schemas.array_codes import delta_zlib_decode, delta_zlib_encode, jpeg_decode, jpeg_encode
from spot3d_schemas.palette_code import ManyValuesError, palette_decode, palette_encode

RAW = "raw"
"""The array's bytes in C order, little endian."""

DELTA_ZLIB = "delta-zlib"
"""Lossless, for (h, w) images; see `delta_zlib_encode`."""

PALETTE, PALETTE_2D = "palette", "palette-2d"
"""Lossless, for (h, w) images of few distinct values; see `palette_code`."""

JPEG = "jpeg"
"""Lossy, for (h, w, 3) uint8 RGB images."""

_MEANING = {
    RAW: "C order, little endian",
    DELTA_ZLIB: "thin links', spot3d_schemas/array_codes.py",
    PALETTE: "thin links', spot3d_schemas/palette_code.py",
    PALETTE_2D: "thin links', spot3d_schemas/palette_code.py",
    JPEG: "the bytes of a JPEG file",
}
"""The encodings for clients in other languages."""

_TYPES = ("uint8", "int8", "uint16", "uint32", "float32", "float64")
_DTYPES = {name: np.dtype(name).newbyteorder("<") for name in _TYPES}
_NAMES = {dtype: name for name, dtype in _DTYPES.items()}


@dataclass(frozen=True, slots=True)
class ArraySpec:
    """What an array field may hold; as an annotation it makes pydantic check the field.

    dtypes: accepted NumPy type names. axes: a number for a fixed axis, a name for a free one. most: largest product of
    the free axes. least: smallest free axis. thin: the encodings beside `raw`, for thin links; the first that can code
    the array is used. finite: whether NaN and infinity are refused.
    """

    dtypes: tuple[str, ...]
    axes: tuple[int | str, ...]
    most: int
    least: int = 0
    thin: tuple[str, ...] = ()
    finite: bool = False

    def check_shape(self, shape: tuple[int, ...]) -> None:
        """Raises ValueError where `shape` is not as described or beyond the limit."""
        described = len(shape) == len(self.axes)
        rows = largest = 1
        for size, axis in zip(shape, self.axes, strict=False):
            if isinstance(axis, int):
                described = described and size == axis
            else:
                described = described and size >= self.least
                rows *= size
                largest = max(largest, size)
        if not described:
            raise ValueError(f"the shape is {list(shape[:8])}; expected ({', '.join(map(str, self.axes))})")
        # Each axis by itself as well: a zero elsewhere must not hide a size that NumPy cannot even state.
        if rows > self.most or largest > self.most:
            free = "x".join(self.free)
            raise ValueError(f"the shape {list(shape)} exceeds the limit of {self.most} {free}; send less")

    @property
    def free(self) -> tuple[str, ...]:
        """The names of the free axes."""
        return tuple(axis for axis in self.axes if isinstance(axis, str))

    def dtype(self, name: object) -> np.dtype[Any]:
        """The little-endian dtype called `name`. Raises ValueError where the field does not take it."""
        if not isinstance(name, str) or name not in self.dtypes:
            raise ValueError(f"the dtype is {str(name)[:40]!r}; send {' or '.join(self.dtypes)}")
        return _DTYPES[name]

    def validated(self, value: object) -> NDArray[Any]:
        """`value` as a read-only, C-contiguous, aligned view, or a copy where it is not laid out like that.

        Raises ValueError where it is no array, or not of the type, shape, size or values described.
        """
        if not isinstance(value, np.ndarray):
            raise ValueError(f"expected a NumPy array, got {type(value).__name__}")
        self.dtype(_NAMES.get(value.dtype) or str(value.dtype))
        self.check_shape(value.shape)
        laid_out = value.flags.c_contiguous and value.flags.aligned
        array = value.view(np.ndarray) if laid_out else np.array(value, order="C")
        array.flags.writeable = False
        if self.finite and not np.isfinite(array).all():
            raise ValueError("contains NaN or infinity; every value must be finite")
        return array

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validated)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        axes = ", ".join(map(str, self.axes))
        sizes = [{"const": axis} if isinstance(axis, int) else {"minimum": self.least} for axis in self.axes]
        return {
            "type": "object",
            "description": f"Array ({axes}); {'x'.join(self.free)} is at most {self.most}.",
            "properties": {
                "dtype": {"enum": list(self.dtypes)},
                "shape": {
                    "type": "array",
                    "prefixItems": [{"type": "integer", **size} for size in sizes],
                    "minItems": len(self.axes),
                    "maxItems": len(self.axes),
                },
                "encoding": {"enum": sorted((RAW, *self.thin))},
                "data": {
                    "type": "string",
                    "contentEncoding": "binary",
                    "description": f"msgpack bin (JSON has no such type). {_meaning(RAW, *sorted(self.thin))}.",
                },
            },
            "required": ["dtype", "shape", "encoding", "data"],
        }


def _meaning(*encodings: str) -> str:
    return "; ".join(f"{name}: {_MEANING[name]}" for name in encodings)


def dtype_name(array: NDArray[Any]) -> str:
    """The wire's name of a validated array's dtype."""
    return _NAMES[array.dtype]


def encode_data(array: NDArray[Any], codes: tuple[str, ...], jpeg_quality: int) -> tuple[str, bytes | memoryview]:
    """The first of `codes` that suits the validated `array`, and its bytes; else `raw`, a view. Raises ValueError."""
    for code in codes:
        if code == JPEG:
            return code, jpeg_encode(array, jpeg_quality)
        if code == DELTA_ZLIB:
            return code, delta_zlib_encode(array)
        try:
            return code, palette_encode(array, plane=code == PALETTE_2D)
        except ManyValuesError:
            continue
    # By way of uint8: a memoryview of an empty array cannot be cast.
    return RAW, array.reshape(-1).view(np.uint8).data


def decode_array(described: Mapping[str, Any], data: memoryview, spec: ArraySpec) -> NDArray[Any]:
    """The array that {dtype, shape, encoding} and `data` describe, little endian.

    `raw` gives a view into `data`, without a copy unless the sender did not align it to the item's size.
    Raises ValueError, before anything is allocated, where the description is not what `spec` accepts.
    """
    dtype = spec.dtype(described.get("dtype"))
    stated = described.get("shape")
    if not isinstance(stated, list) or not all(type(size) is int and size >= 0 for size in stated):
        raise ValueError("the shape must be a list of integers")
    shape = tuple(stated)
    spec.check_shape(shape)
    encoding = described.get("encoding")
    if encoding == RAW:
        expected = math.prod(shape) * dtype.itemsize
        if len(data) != expected:
            raise ValueError(f"{len(data)} bytes of data, but {dtype} of shape {list(shape)} takes {expected}")
        return np.frombuffer(data, dtype).reshape(shape)
    if encoding not in spec.thin:
        accepted = " or ".join(sorted((RAW, *spec.thin)))
        raise ValueError(f"the encoding is {str(encoding)[:40]!r}; send {accepted}")
    if encoding == JPEG:
        return jpeg_decode(data, shape)
    if encoding == DELTA_ZLIB:
        return delta_zlib_decode(data, dtype, shape)
    return palette_decode(data, dtype, shape, plane=encoding == PALETTE_2D)
