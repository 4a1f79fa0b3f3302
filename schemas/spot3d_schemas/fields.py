"""The types of the fields of messages."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

from spot3d_schemas.arrays import DELTA_ZLIB, JPEG, PALETTE, PALETTE_2D, ArraySpec
from spot3d_schemas.limits import (
    BEND_SHAPE,
    MAX_BOXES,
    MAX_CORRECTIONS,
    MAX_COUNT,
    MAX_IMAGE_PIXELS,
    MAX_MAP_CHANGES,
    MAX_MAP_POINTS,
    MAX_NAME,
    MAX_PLANES,
    MAX_PREVIEW_PIXELS,
    MAX_REASONS,
    MAX_SEGMENTS,
    MAX_TEXT,
)
from spot3d_schemas.names import checked_name
from spot3d_schemas.numbers_field import NumbersSpec

_UNIT_TOLERANCE = 2e-3
"""Tolerance of the square of a unit vector's length: 1e-3 on the length."""


def _with_unit_normals(planes: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(over="ignore"):  # what overflows is no unit vector
        lengths = (planes[:, :3] ** 2).sum(axis=1)
    if not (np.abs(lengths - 1) <= _UNIT_TOLERANCE).all():
        raise ValueError("the first three numbers of each plane are its unit normal, to 1e-3")
    return planes


def _cut(text: object) -> object:
    # The message is worth more than the end of a long error text, or the exact spelling of a file's odd name in it.
    return text.encode("utf-8", "backslashreplace").decode()[:MAX_TEXT] if isinstance(text, str) else text


Name = Annotated[str, AfterValidator(checked_name), WithJsonSchema({"type": "string", "maxLength": MAX_NAME})]
Text = Annotated[str, BeforeValidator(_cut), Field(max_length=MAX_TEXT)]
Byte = Annotated[int, Field(ge=0, le=255)]
Count = Annotated[int, Field(ge=0, le=MAX_COUNT)]
Nanoseconds = Annotated[int, Field(ge=0, le=MAX_COUNT)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Reasons = Annotated[dict[Annotated[str, Field(max_length=MAX_NAME)], Count], Field(max_length=MAX_REASONS)]
"""Counts by reason."""

Point2 = Annotated[NDArray[np.float64], NumbersSpec((2,))]
Vector = Annotated[NDArray[np.float64], NumbersSpec((3,))]
Rotation = Annotated[NDArray[np.float64], NumbersSpec((3, 3), "rotation")]
Lattice = Annotated[NDArray[np.float64], NumbersSpec(BEND_SHAPE)]
Transform = Annotated[NDArray[np.float64], NumbersSpec((4, 4), "rigid")]

_IMAGE = ("h", "w")
Colour = Annotated[NDArray[np.uint8], ArraySpec(("uint8",), ("h", "w", 3), MAX_IMAGE_PIXELS, least=1, thin=(JPEG,))]
Depth = Annotated[
    NDArray[np.uint16] | NDArray[np.float32],
    ArraySpec(("uint16", "float32"), _IMAGE, MAX_IMAGE_PIXELS, least=1, thin=(PALETTE, DELTA_ZLIB)),
]
HeatImage = Annotated[
    NDArray[np.uint8], ArraySpec(("uint8",), _IMAGE, MAX_IMAGE_PIXELS, least=1, thin=(PALETTE_2D, DELTA_ZLIB))
]
LabelImage = Annotated[NDArray[np.uint8], ArraySpec(("uint8",), _IMAGE, MAX_IMAGE_PIXELS, thin=(DELTA_ZLIB,))]
SegmentHeat = Annotated[NDArray[np.float32], ArraySpec(("float32",), ("n",), MAX_SEGMENTS, finite=True)]
Planes = Annotated[
    NDArray[np.float64], ArraySpec(("float64",), ("p", 4), MAX_PLANES, finite=True), AfterValidator(_with_unit_normals)
]
SegmentSupports = Annotated[NDArray[np.int8], ArraySpec(("int8",), ("n",), MAX_SEGMENTS)]
Boxes = Annotated[NDArray[np.float32], ArraySpec(("float32",), ("M", 5), MAX_BOXES, finite=True)]
PoseTwists = Annotated[NDArray[np.float64], ArraySpec(("float64",), ("k", 6), MAX_CORRECTIONS, finite=True)]
Points = Annotated[NDArray[np.float32], ArraySpec(("float32",), ("N", 3), MAX_MAP_POINTS)]
PointColours = Annotated[NDArray[np.uint8], ArraySpec(("uint8",), ("N", 3), MAX_MAP_POINTS)]
PointHeat = Annotated[NDArray[np.float32], ArraySpec(("float32",), ("N",), MAX_MAP_POINTS)]
PointCounts = Annotated[NDArray[np.uint32], ArraySpec(("uint32",), ("N",), MAX_MAP_POINTS)]

PreviewColour = Annotated[
    NDArray[np.uint8], ArraySpec(("uint8",), ("h", "w", 3), MAX_PREVIEW_PIXELS, least=1, thin=(JPEG,))
]
PointNumbers = Annotated[NDArray[np.uint32], ArraySpec(("uint32",), ("N",), MAX_MAP_CHANGES)]
ChangedPoints = Annotated[NDArray[np.float32], ArraySpec(("float32",), ("N", 3), MAX_MAP_CHANGES)]
ChangedColours = Annotated[NDArray[np.uint8], ArraySpec(("uint8",), ("N", 3), MAX_MAP_CHANGES)]
ChangedHeat = Annotated[NDArray[np.uint8], ArraySpec(("uint8",), ("N",), MAX_MAP_CHANGES)]

Array = NDArray[Any]
