"""The messages of the dataflow, version 1 (each states its minor version: `VERSION`).

Units: metres, seconds (milliseconds where a name says _ms), integer nanoseconds. The camera frame is optical
(x right, y down, z forward). Arrays are read-only views: of a decoded message into its payload, of a message
made here into the arrays that it was made of, which must not be changed until it is encoded.

Values are checked strictly, once, when a message is made or decoded. Fields that are not listed here are
ignored, not refused: a newer minor version adds fields, and its messages must stay readable; a change that
would mislead an old reader takes a new major version. Since a misspelt field is ignored as well, every field of
1.0 but the header's trace must be given: what is missing is refused. What a minor version has added may be missing,
since older senders do not know it: 1.1 added the header's stream and sender.
"""

from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import FailFast, Field, ValidationInfo, field_validator, model_validator

from spot3d_schemas.fields import (
    Array,
    Boxes,
    Byte,
    ChangedColours,
    ChangedHeat,
    ChangedPoints,
    Colour,
    Count,
    Depth,
    Finite,
    HeatImage,
    LabelImage,
    Lattice,
    Name,
    Nanoseconds,
    NonNegative,
    Planes,
    Point2,
    PointColours,
    PointCounts,
    PointHeat,
    PointNumbers,
    Points,
    PoseTwists,
    Positive,
    PreviewColour,
    Reasons,
    Rotation,
    SegmentHeat,
    SegmentSupports,
    Text,
    Transform,
    Vector,
)
from spot3d_schemas.header import Header, Record
from spot3d_schemas.limits import (
    MAX_BEND,
    MAX_CORRECTIONS,
    MAX_DEPTH_NOISE,
    MAX_FIELD_BYTES,
    MAX_IMAGE_PIXELS,
    MAX_IMAGE_SIDE,
    MAX_LEAST_NOISY_RANGE,
    MAX_OBJECTS,
    MAX_OBJECTS_BYTES,
    MAX_OBJECTS_VALUES,
    MAX_VALUES,
    MIN_DEPTH_NOISE,
)


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
            raise ValueError(f"{self.width}x{self.height} is beyond the limit of {MAX_IMAGE_PIXELS} pixels")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (height, width), as NumPy states it."""
        return (self.height, self.width)


class DepthNoise(Record):
    """How noisy depth is: sigma(z) = floor + growth * (z - at)^2 (`model` quadratic), all metres.

    A stereo camera: at 0, growth = subpixel / (focal length * baseline); time of flight: little growth. What no camera
    has, as millimetres in the place of metres, is refused.
    """

    model: Literal["quadratic"] = "quadratic"
    floor: Annotated[float, Field(ge=MIN_DEPTH_NOISE, le=MAX_DEPTH_NOISE)]
    growth: Annotated[float, Field(ge=0, le=MAX_DEPTH_NOISE)]
    at: Annotated[float, Field(ge=0, le=MAX_LEAST_NOISY_RANGE)]

    @model_validator(mode="after")
    def _is_a_cameras(self) -> Self:
        sigma = self.floor + self.growth * (1 - self.at) ** 2
        if sigma > MAX_DEPTH_NOISE:
            raise ValueError(f"{sigma:g} m at 1 m is more than a depth camera's noise: is it in metres?")
        return self


class Message(Record):
    """What every message has."""

    SCHEMA: ClassVar[str]
    VERSION: ClassVar[str] = "1.1"
    MAX_VALUES: ClassVar[int] = MAX_VALUES
    MAX_FIELD_BYTES: ClassVar[int] = MAX_FIELD_BYTES

    header: Header


def _of_the_size(image: Array, info: ValidationInfo) -> Array:
    intrinsics = info.data.get("intrinsics")
    if intrinsics is not None and image.shape[:2] != intrinsics.shape:
        raise ValueError(f"is {list(image.shape)}, but the intrinsics are for {list(intrinsics.shape)} (h, w)")
    return image


class RgbdMessage(Message):
    """What Frame and Heat share: one RGB-D image with its units and intrinsics.

    colour: (h, w, 3) uint8 RGB, registered with depth.
    depth: (h, w) uint16 in units of `depth_scale` metres, or float32 metres (`depth_scale` 1); 0 = invalid.
    depth_noise: since 1.1, the depth camera's; None: not stated, and taken for a Kinect v1's.
    """

    VERSION: ClassVar[str] = "1.1"

    intrinsics: CameraIntrinsics
    depth_scale: Positive
    colour: Colour
    depth: Depth
    depth_noise: DepthNoise | None = None

    @field_validator("colour", "depth", "heat", check_fields=False)
    @classmethod
    def _has_the_size_of_the_intrinsics(cls, image: Array, info: ValidationInfo) -> Array:
        return _of_the_size(image, info)

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


class Preview(Message):
    """A small picture of a frame for people, up to 320 pixels wide, on the wire as JPEG.

    intrinsics: of this picture. colour: (h, w, 3) uint8 RGB: what the camera sees (source/preview), or the frame's heat
    as grey, 255 = its maximum (heatmap/preview). Published at most five times a second, and only while somebody
    subscribes.
    """

    SCHEMA: ClassVar[str] = "spot3d.Preview"

    intrinsics: CameraIntrinsics
    colour: PreviewColour

    @field_validator("colour")
    @classmethod
    def _fits_the_intrinsics(cls, image: Array, info: ValidationInfo) -> Array:
        return _of_the_size(image, info)


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
    """The objects of one keyframe alone; of a frame that is none, only that it is none.

    keyframe: whether the frame was looked at. If not, `intrinsics` is None and the arrays are empty (labels 0x0).
    intrinsics: of `labels`, which may be smaller than the frame. labels: (h, w) uint8, 0 = no object, k = segment
    k - 1. heat: (n,) float32 mean confidence of each segment in [0, 1]. planes: (p, 4) float64 [n_x, n_y, n_z, b],
    camera frame, metres, n.x + b = 0: the surfaces on which things stand, the main one first, unit normals up, in depth
    as it was measured but for the pose's `bend`.
    stands_on: (n,) int8 row of `planes`, -1 = none is known. Since 1.2, left_out: what was taken for an object of this
    frame and is no segment, counted by reason.
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
            raise ValueError(f"reaches from {heat.min():.3g} to {heat.max():.3g}; a confidence is in [0, 1]")
        return heat

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.keyframe != (self.intrinsics is not None):
            raise ValueError("intrinsics are those of a keyframe's labels, and only of a keyframe's")
        shape = (0, 0) if self.intrinsics is None else self.intrinsics.shape
        if self.labels.shape != shape:
            raise ValueError(f"labels are {list(self.labels.shape)}; expected {list(shape)} (h, w)")
        count, most = len(self.heat), int(self.labels.max(initial=0))
        if not self.keyframe and (count or len(self.planes)):
            raise ValueError("a frame that is no keyframe has no segments and no planes")
        if most > count:
            raise ValueError(f"labels reach {most}, but heat has {count} rows: one for each segment")
        if len(self.stands_on) != count:
            raise ValueError(f"stands_on has {len(self.stands_on)} rows, but heat has {count}")
        if count and not (self.stands_on.min() >= -1 and self.stands_on.max() < len(self.planes)):
            raise ValueError(f"stands_on names rows of the {len(self.planes)} planes, or -1")
        return self


class End(Message):
    """The source's stream has ended; said again and again until fusion's progress answers that it is complete.

    The header's stamp is that of the last frame. frames_sent: how many there were.
    """

    SCHEMA: ClassVar[str] = "spot3d.End"

    frames_sent: Count


class Pose(Message):
    """The camera's pose at one capture. "lost": not to be fused, and `reason` says why.

    Since 1.1, epoch: the world that the pose is in; poses of different epochs have nothing to do with each other.
    lost_since_ns: the capture since which every pose is lost. Since 1.2, T_world_map: where the map by which poses are
    corrected is known to lie by now; None: where it always was. What was seen by an earlier pose is better known to lie
    where T_world_map inv(T_world_map of then) brings it. Since 1.3, depth_factor: what the capture's depth is to be
    multiplied by to agree with the poses; 1: they agree, or nobody knows. Since 1.4, delay_s: how much older than the
    capture the pose was as it was given, seconds; it has been carried on by that; 0: it came in time, or nobody knows.
    Since 1.5, turn: (3,) rotation vector about the camera's axes, radians, by which the camera is turned against what
    the given pose is of, as far as was known by then: it is part of the pose; None: the pose is as it was given.
    Since 1.6, centre: (2,) by how much further to the right and down a thing at unit distance lies than the capture's
    intrinsics say: cx and cy are to be less by so many focal lengths; None: nobody knows.
    Since 1.7, corrected_ns: (k,) captures from before, rising, and corrections: (k, 6) float64, by how much the pose
    of each, as it was published and then moved with the map, turns out to be off: shift, metres, and rotation about the
    camera, radians, in world axes; `turn` is not part of it. What lies between is off in line with both, what is later
    than the last as that is, and of what is earlier than the first nothing is said: what was said before holds.
    Since 1.8, bend: (4, 6) the logarithm of what the capture's depth is to be multiplied by beside depth_factor, on a
    lattice of rows and columns from the image's left upper to its right lower corner, in between in line with both: a
    camera bends what it sees alike in all images; None: nobody knows.
    """

    SCHEMA: ClassVar[str] = "spot3d.Pose"
    VERSION: ClassVar[str] = "1.8"

    T_world_camera: Transform
    status: Literal["ok", "lost"]
    reason: Text
    provider: Name
    epoch: Name | None = None
    lost_since_ns: Nanoseconds | None = None
    T_world_map: Transform | None = None
    depth_factor: Annotated[float, Field(ge=0.5, le=2)] = 1.0
    delay_s: Finite = 0.0
    turn: Vector | None = None
    centre: Point2 | None = None
    bend: Lattice | None = None
    corrected_ns: Annotated[tuple[Nanoseconds, ...], FailFast(), Field(strict=False, max_length=MAX_CORRECTIONS)] = ()
    corrections: PoseTwists = Field(default_factory=lambda: np.zeros((0, 6)))

    @field_validator("bend")
    @classmethod
    def _is_hardly_bent(cls, bend: Array | None) -> Array | None:
        if bend is not None and np.abs(bend).max() > MAX_BEND:
            raise ValueError(f"reaches {np.abs(bend).max():.3g}; the logarithm of a factor, it may reach {MAX_BEND}")
        return bend

    @field_validator("corrected_ns")
    @classmethod
    def _stamps_rise(cls, stamps: tuple[int, ...]) -> tuple[int, ...]:
        if any(later <= earlier for earlier, later in pairwise(stamps)):
            raise ValueError("each stamp must be later than the one before it")
        return stamps

    @model_validator(mode="after")
    def _one_for_each_stamp(self) -> Self:
        if len(self.corrections) != len(self.corrected_ns):
            raise ValueError(
                f"has {len(self.corrections)} corrections, but {len(self.corrected_ns)} stamps in corrected_ns"
            )
        return self


class Proposals(Message):
    """Generic boxes of one frame. boxes: (M, 5) float32 [x, y, w, h, c], pixels and confidence."""

    SCHEMA: ClassVar[str] = "spot3d.Proposals"

    boxes: Boxes


class Object3D(Record):
    """One object's box. centre, size: (3,) m. rotation: (3, 3), columns = the box's axes. World frame.

    views, by default: keyframes that see it; points: pixels of its segments, summed over these, not points of the map.
    """

    id: Count
    confidence: NonNegative
    views: Count
    centre: Vector
    size: Vector
    rotation: Rotation
    points: Count
    colour: Annotated[tuple[Byte, Byte, Byte], Field(strict=False)]
    """Mean colour, RGB."""

    @field_validator("size")
    @classmethod
    def _size_is_not_negative(cls, size: Array) -> Array:
        if (size < 0).any():
            raise ValueError(f"is {size.tolist()}; no side may be negative")
        return size


class Objects(Message):
    """All objects known after `frame_count` fused frames. up: (3,) the supporting planes' normal, world.

    complete: the source's stream has ended, and these are the objects of all its frames. Since 1.1, left_out: what
    was taken for an object and is none, counted by reason (`... in a keyframe`: what the segments stage said of single
    keyframes, added up over all); keyframes_dropped: keyframes that were forgotten because there were too many, and
    with them what no other keyframe shows. Since 1.2, epoch: of the map that they are from; the numbers of objects
    mean the same in one epoch alone.
    """

    SCHEMA: ClassVar[str] = "spot3d.Objects"
    VERSION: ClassVar[str] = "1.2"
    MAX_VALUES: ClassVar[int] = MAX_OBJECTS_VALUES
    MAX_FIELD_BYTES: ClassVar[int] = MAX_OBJECTS_BYTES

    objects: Annotated[tuple[Object3D, ...], FailFast(), Field(strict=False, max_length=MAX_OBJECTS)]
    up: Vector
    frame_count: Count
    map_points: Count
    map_limit_reached: bool
    complete: bool
    left_out: Reasons = Field(default_factory=dict)
    keyframes_dropped: Count = 0
    epoch: Name | None = None


class MapPoints(Message):
    """A bounded snapshot of the 3D heatmap, N of its `total` points.

    xyz: (N, 3) float32 m, world. rgb: (N, 3) uint8. heat: (N,) float32 pseudo-average confidence.
    frequency: (N,) uint32 frames that saw the point. Since 1.1, epoch: of the map, as in Objects.
    """

    SCHEMA: ClassVar[str] = "spot3d.MapPoints"

    xyz: Points
    rgb: PointColours
    heat: PointHeat
    frequency: PointCounts
    total: Count
    epoch: Name | None = None

    @field_validator("rgb", "heat", "frequency")
    @classmethod
    def _one_for_each_point(cls, values: Array, info: ValidationInfo) -> Array:
        xyz = info.data.get("xyz")
        if xyz is not None and len(values) != len(xyz):
            raise ValueError(f"has {len(values)} rows, but xyz has {len(xyz)}")
        return values


class MapChanges(Message):
    """What changed in the 3D heatmap after what the asker has; the answer to `fusion/changes`.

    The query's parameters: `generation` and `since` of the last answer (none: everything), `limit`: most points.
    generation: another number is another map, of which the asker has nothing yet. cursor: the next query's `since`.
    behind: changed points that did not fit into this answer; ask again.
    number: (N,) uint32 that stays the point's. xyz: (N, 3) float32 m, world. rgb: (N, 3) uint8. heat: (N,) uint8
    255ths of the pseudo-average confidence. frequency: (N,) uint32 frames that saw the point, 0 = it is no more.
    planes: (p, 4) float64 [n_x, n_y, n_z, b], world, metres, n.x + b = 0: surfaces on which things stand, seen of late.
    Since 1.1, epoch: of the map, as in Objects: a fusion that is started again goes on with the objects of its epoch.
    """

    SCHEMA: ClassVar[str] = "spot3d.MapChanges"
    VERSION: ClassVar[str] = "1.1"

    generation: Count
    cursor: Count
    behind: Count
    number: PointNumbers
    xyz: ChangedPoints
    rgb: ChangedColours
    heat: ChangedHeat
    frequency: PointNumbers
    planes: Planes
    total: Count
    epoch: Name | None = None

    @field_validator("xyz", "rgb", "heat", "frequency")
    @classmethod
    def _one_for_each_point(cls, values: Array, info: ValidationInfo) -> Array:
        number = info.data.get("number")
        if number is not None and len(values) != len(number):
            raise ValueError(f"has {len(values)} rows, but number has {len(number)}")
        return values


class Progress(Message):
    """What fusion has done with the frames so far; the source's credit in a lossless run.

    All frames up to `last_stamp_ns` are accounted for: fused or skipped. complete: so is the whole stream,
    and the last objects are published.
    """

    SCHEMA: ClassVar[str] = "spot3d.Progress"

    fused: Count
    skipped: Reasons
    last_stamp_ns: Nanoseconds
    complete: bool


class Health(Message):
    """How one stage's process fares. Rates and times are None until there is something to measure.

    drops: messages that were not worked on, by reason. events: what happened that lost nothing, by kind.
    latency: from the trace's first hop to this stage's message, by wall clock. step: the core's own time. Since 1.1,
    state: what is wrong now and what to do about it, for people; empty: nothing is; and sent, sent_bytes: messages and
    their bytes so far, by topic.
    """

    SCHEMA: ClassVar[str] = "spot3d.Health"
    VERSION: ClassVar[str] = "1.1"

    stage: Name
    pid: Count
    uptime_s: NonNegative
    received: Count
    published: Count
    drops: Reasons
    events: Reasons
    errors: Count
    last_error: Text
    rate_hz: NonNegative | None
    latency_ms_p50: Finite | None
    latency_ms_p99: Finite | None
    step_ms_p50: NonNegative | None
    step_ms_p99: NonNegative | None
    cpu_s: NonNegative
    rss_bytes: Count
    threads: Count
    state: Text = ""
    sent: Reasons = Field(default_factory=dict)
    sent_bytes: Reasons = Field(default_factory=dict)


class About(Message):
    """What one stage's process runs on: its answer to a query, at once, however busy the stage is.

    time_ns: wall clock when it answered. kernels_missing: modules whose machine code is not kept for the next start.
    shared_memory_bytes: room for images that go through shared memory, 0 where none do: it is off, or the run lossless.
    disk, disk_free_bytes: where the stage keeps things, and what room is left there. certificate_until_ns: until when
    its certificate is valid.
    """

    SCHEMA: ClassVar[str] = "spot3d.About"

    stage: Name
    pid: Count
    host: Text
    spot3d: Text
    zenoh: Text
    python: Text
    time_ns: Nanoseconds
    kernels_missing: Count
    shared_memory_bytes: Count
    disk: Text
    disk_free_bytes: Count
    certificate_until_ns: Nanoseconds | None


MESSAGES: dict[str, type[Message]] = {
    message.__name__: message
    for message in (
        Frame,
        Preview,
        End,
        Pose,
        Proposals,
        Heat,
        Segments,
        Objects,
        MapPoints,
        MapChanges,
        Progress,
        Health,
        About,
    )
}
"""Every message by its short name."""
