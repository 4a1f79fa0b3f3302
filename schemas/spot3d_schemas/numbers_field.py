"""Short rows of numbers (vectors, rotations, poses): flat lists on the wire, float64 arrays for users."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

_TOLERANCE = 1e-3
_ROUNDING = 1e-5
"""A rotation that is farther off is replaced by the nearest one, as products of it would soon be none. Of numbers with
six decimals, or float32, it stays as it was sent."""


@dataclass(frozen=True, slots=True)
class NumbersSpec:
    """A float64 field of `shape`, on the wire a flat row-major list; an annotation that pydantic checks.

    meaning: "vector" (any finite numbers), "rotation" (3x3) or "rigid" (4x4: rotation, translation, 0 0 0 1). Rotations
    may be rounded: one that is orthonormal to 1e-3 only is made exact.
    """

    shape: tuple[int, ...]
    meaning: Literal["vector", "rotation", "rigid"] = "vector"

    def validated(self, value: object) -> NDArray[np.float64]:
        """A read-only array of `shape` from an array of that shape or a flat list. Raises ValueError."""
        if isinstance(value, np.ndarray):
            if value.shape != self.shape or value.dtype.kind not in "fiu":
                raise ValueError(f"is {value.dtype} {list(value.shape)}; expected float64 {list(self.shape)}")
            numbers = _flat(value)
        else:
            numbers = _checked_list(value, math.prod(self.shape))
        # Plain floats: on so few numbers NumPy's calls would take most of the time of decoding a frame.
        if not all(map(math.isfinite, numbers)):
            raise ValueError("contains NaN or infinity; every number must be finite")
        off = 0.0
        if self.meaning == "rigid":
            off = _checked_rotation(numbers[0:3], numbers[4:7], numbers[8:11])
            if max(abs(n - m) for n, m in zip(numbers[12:], (0, 0, 0, 1), strict=True)) > _TOLERANCE:
                raise ValueError(f"the bottom row is {numbers[12:]}; that of a rigid transform must be 0 0 0 1")
        elif self.meaning == "rotation":
            off = _checked_rotation(numbers[0:3], numbers[3:6], numbers[6:9])
        array = np.array(numbers, dtype=np.float64).reshape(self.shape)
        if off > _ROUNDING:
            u, _, vt = np.linalg.svd(array[:3, :3])
            array[:3, :3] = u @ vt
        array.flags.writeable = False
        return array

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        flat = core_schema.plain_serializer_function_ser_schema(_flat)
        return core_schema.no_info_plain_validator_function(self.validated, serialization=flat)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        count = math.prod(self.shape)
        shape = "x".join(map(str, self.shape))
        return {
            "type": "array",
            "items": {"type": "number"},
            "minItems": count,
            "maxItems": count,
            "description": f"{shape} {self.meaning}" + ", row-major" * (len(self.shape) > 1),
        }


def _checked_list(value: object, count: int) -> list[float]:
    if not isinstance(value, list | tuple) or len(value) != count:
        raise ValueError(f"expected a list of {count} numbers (matrices in row-major order)")
    if not all(type(number) is float or type(number) is int for number in value):
        raise ValueError("every item must be a number")
    return list(value)


def _flat(array: NDArray[Any]) -> list[float]:
    numbers: list[float] = array.ravel().tolist()
    return numbers


def _checked_rotation(x: list[float], y: list[float], z: list[float]) -> float:
    """How far the rows x, y, z are from orthonormal. Raises ValueError where they are not those of a rotation."""
    lengths = (_dot(x, x) - 1, _dot(y, y) - 1, _dot(z, z) - 1)
    products = (_dot(x, y), _dot(y, z), _dot(z, x))
    off = max(map(abs, (*lengths, *products)))
    if off > _TOLERANCE:
        raise ValueError("the 3x3 part is not a rotation: its rows must be orthonormal to 1e-3")
    cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
    if _dot(cross, z) < 0:
        raise ValueError("the 3x3 part is a reflection (determinant -1); that of a rotation must be +1")
    return off


def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
