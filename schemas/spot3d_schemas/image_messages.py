"""The messages about one frame: its images, and what the stages find in them."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from spot3d_schemas.fields import (
    Array,
    Boxes,
    Colour,
    Count,
    Depth,
    Finite,
    HeatImage,
    LabelImage,
    Planes,
    Positive,
    PreviewColour,
    Reasons,
    SegmentHeat,
    SegmentSupports,
    Transform,
)
from spot3d_schemas.limits import (
    MAX_DEPTH_NOISE,
    MAX_IMAGE_PIXELS,
    MAX_IMAGE_SIDE,
    MAX_LEAST_NOISY_RANGE,
    MIN_DEPTH_NOISE,
)
from spot3d_schemas.message import Message, Record


class CameraIntrinsics(Record):
    """Pinhole intrinsics in pixels for exactly one image size; pixel centres are at integer coordinates."""

    fx: Positive
    fy: Positive
    cx: Finite
    cy: Finite
    width: Annotated[int, Field(ge=1, le=MAX_IMAGE_SIDE)]
    height: Annotated[int, Field(ge=1, le=MAX_IMAGE_SIDE)]

    @model_validator(mode="after")
    def _within_limit(self) -> Self:
        if self.width * self.height > MAX_IMAGE_PIXELS:
            raise ValueError(
                f"{self.width}x{self.height} exceeds the limit of {MAX_IMAGE_PIXELS} pixels; scale the images down"
            )
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (height, width), as NumPy states it."""
        return (self.height, self.width)


class DepthNoise(Record):
    """Standard deviation of depth: sigma(z) = floor + growth * (z - at)^2 (`model` quadratic), all metres.

    A stereo camera: at 0, growth = subpixel / (focal length * baseline); time of flight: little growth. Values that no
    camera has, such as millimetres instead of metres, are refused.
    """

    model: Literal["quadratic"] = "quadratic"
    floor: Annotated[float, Field(ge=MIN_DEPTH_NOISE, le=MAX_DEPTH_NOISE)]
    growth: Annotated[float, Field(ge=0, le=MAX_DEPTH_NOISE)]
    at: Annotated[float, Field(ge=0, le=MAX_LEAST_NOISY_RANGE)]

    @model_validator(mode="after")
    def _is_a_cameras(self) -> Self:
        sigma = self.floor + self.growth * (1 - self.at) ** 2
        if sigma > MAX_DEPTH_NOISE:
            raise ValueError(f"{sigma:g} m at 1 m is implausibly large for a depth camera; give it in metres")
        return self


class ImageMessage(Message):
    """What all messages with images share: the intrinsics that state their size."""

    intrinsics: CameraIntrinsics

    @field_validator("colour", "depth", "heat", check_fields=False)
    @classmethod
    def _has_the_size_of_the_intrinsics(cls, image: Array, info: ValidationInfo) -> Array:
        intrinsics = info.data.get("intrinsics")
        if intrinsics is not None and image.shape[:2] != intrinsics.shape:
            raise ValueError(f"is {list(image.shape)}, but the intrinsics are for {list(intrinsics.shape)} (h, w)")
        return image


class RgbdMessage(ImageMessage):
    """What Frame and Heat share: one RGB-D image with its units and intrinsics.

    colour: (h, w, 3) uint8 RGB, registered with depth.
    depth: (h, w) uint16 in units of `depth_scale` metres, or float32 metres (`depth_scale` 1); 0 = invalid.
    depth_noise: since 1.1, the depth camera's; None: not stated, a Kinect v1's is assumed.
    """

    VERSION: ClassVar[str] = "1.1"

    depth_scale: Positive
    colour: Colour
    depth: Depth
    depth_noise: DepthNoise | None = None

    @field_validator("depth")
    @classmethod
    def _float_depth_is_metres(cls, depth: Array, info: ValidationInfo) -> Array:
        if depth.dtype == np.float32 and info.data.get("depth_scale", 1) != 1:
            raise ValueError("float32 depth is in metres: depth_scale must be 1")
        return depth


class Frame(RgbdMessage):
    """An RGB-D frame. T_world_camera: (4, 4) float64 pose that the source itself knows, or None."""

    SCHEMA: ClassVar[str] = "spot3d.Frame"

    T_world_camera: Transform | None


class Proposals(Message):
    """Generic boxes of one frame. boxes: (M, 5) float32 [x, y, w, h, c], pixels and confidence."""

    SCHEMA: ClassVar[str] = "spot3d.Proposals"

    boxes: Boxes


class Preview(ImageMessage):
    """A small picture of a frame for people, up to 320 pixels wide, on the wire as JPEG.

    intrinsics: of this picture. colour: (h, w, 3) uint8 RGB: what the camera sees (source/preview), or the frame's heat
    as grey, 255 = its maximum (heatmap/preview). Published at most five times a second, and only while somebody
    subscribes.
    """

    SCHEMA: ClassVar[str] = "spot3d.Preview"

    colour: PreviewColour


class Heat(RgbdMessage):
    """A frame's weighted 2D heatmap with all that fusion needs of the frame (paper, Sec. IV-C, Eq. 6).

    heat: (h, w) uint8, 255 = the frame's maximum. accepted, masked, rejected: counts of boxes (hard filter).
    """

    SCHEMA: ClassVar[str] = "spot3d.Heat"

    heat: HeatImage
    accepted: Count
    masked: Count
    rejected: Count


class Segments(Message):
    """The segments of one keyframe; of any other frame, only that it is none.

    keyframe: whether the frame was segmented. If not, `intrinsics` is None and the arrays are empty (labels 0x0).
    intrinsics: of `labels`, which may be smaller than the frame. labels: (h, w) uint8, 0 = no object, k = segment k -
    1. heat: (n,) float32 mean confidence of each segment in [0, 1]. planes: (p, 4) float64 [n_x, n_y, n_z, b], camera
    frame, metres, n.x + b = 0: the supporting planes, the main one first, unit normals up, in depth as measured but for
    the pose's `bend`.
    stands_on: (n,) int8 row of `planes`, -1 = none is known. A sender that knows no plane sends none, and fusion takes
    the supporting plane that it knows itself. Since 1.2, left_out: candidates of this frame that are no segments,
    counted by reason.
    """

    SCHEMA: ClassVar[str] = "spot3d.Segments"
    VERSION: ClassVar[str] = "1.2"

    keyframe: bool
    intrinsics: CameraIntrinsics | None
    labels: LabelImage
    heat: SegmentHeat
    planes: Planes
    stands_on: SegmentSupports
    left_out: Reasons = Field(default_factory=dict)

    @field_validator("heat")
    @classmethod
    def _heat_is_a_confidence(cls, heat: Array) -> Array:
        if heat.size and not (heat.min() >= 0 and heat.max() <= 1):
            raise ValueError(f"ranges from {heat.min():.3g} to {heat.max():.3g}; a confidence must be in [0, 1]")
        return heat

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.keyframe != (self.intrinsics is not None):
            raise ValueError("a keyframe must have intrinsics, and any other frame must have none")
        shape = (0, 0) if self.intrinsics is None else self.intrinsics.shape
        if self.labels.shape != shape:
            raise ValueError(f"labels are {list(self.labels.shape)}; expected {list(shape)} (h, w)")
        count, most = len(self.heat), int(self.labels.max(initial=0))
        if not self.keyframe and (count or len(self.planes)):
            raise ValueError("a frame that is not a keyframe must have no segments and no planes")
        if most > count:
            raise ValueError(f"the largest label is {most}, but heat has {count} rows; send one row for each segment")
        if len(self.stands_on) != count:
            raise ValueError(
                f"stands_on has {len(self.stands_on)} rows, but heat has {count}; send one for each segment"
            )
        if count and not (self.stands_on.min() >= -1 and self.stands_on.max() < len(self.planes)):
            raise ValueError(f"stands_on must hold rows of the {len(self.planes)} planes, or -1")
        return self
