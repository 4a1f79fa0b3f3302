"""The messages about the world: the camera's pose, the objects, and the map."""

from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import FailFast, Field, ValidationInfo, field_validator, model_validator

from spot3d_schemas.fields import (
    Array,
    Byte,
    ChangedColours,
    ChangedHeat,
    ChangedPoints,
    Count,
    Finite,
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
    Reasons,
    Rotation,
    Text,
    Transform,
    Vector,
)
from spot3d_schemas.limits import MAX_BEND, MAX_CORRECTIONS, MAX_OBJECTS, MAX_OBJECTS_BYTES, MAX_OBJECTS_VALUES
from spot3d_schemas.message import Message, Record


class Pose(Message):
    """The camera's pose at one capture. "lost": not to be fused, and `reason` says why.

    Since 1.1, epoch: the world frame of the pose; poses of different epochs are unrelated. lost_since_ns: the capture
    since which every pose is lost.
    Since 1.2, T_world_map: the present pose of the map by which poses are corrected; None: it has not moved. What was
    seen by an earlier pose is better placed where T_world_map inv(T_world_map of then) brings it.
    Since 1.3, depth_factor: the factor by which the capture's depth has to be multiplied to agree with the poses; 1:
    they agree, or it is unknown.
    Since 1.4, delay_s: how much older than the capture the given pose was, seconds; it has been extrapolated by that;
    0: it came in time, or it is unknown.
    Since 1.5, turn: (3,) rotation vector about the camera's axes, radians, of the camera against what the given pose is
    of, as far as known by then. It is part of the pose; None: the pose is as it was given.
    Since 1.6, centre: (2,) by how much further to the right and down a point at unit distance lies than the capture's
    intrinsics say: cx and cy have to be reduced by so many focal lengths; None: unknown.
    Since 1.7, corrected_ns: (k,) earlier captures, rising, and corrections: (k, 6) float64, by how much the pose of
    each, as it was published and then moved with the map, turns out to be off: shift, metres, and rotation about the
    camera, radians, in world axes, without `turn`. They are interpolated linearly in between, and constant after the
    last; before the first, what was said earlier holds.
    Since 1.8, bend: (4, 6) logarithm of the factor by which the capture's depth has to be multiplied beside
    depth_factor, on a lattice of rows and columns from the image's upper left to its lower right corner, interpolated
    linearly: a camera bends depth alike in all images; None: unknown.
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
            raise ValueError(f"reaches {np.abs(bend).max():.3g}; logarithms of factors must stay within {MAX_BEND}")
        return bend

    @field_validator("corrected_ns")
    @classmethod
    def _stamps_rise(cls, stamps: tuple[int, ...]) -> tuple[int, ...]:
        if any(later <= earlier for earlier, later in pairwise(stamps)):
            raise ValueError("each timestamp must be later than the one before it")
        return stamps

    @model_validator(mode="after")
    def _one_for_each_stamp(self) -> Self:
        if len(self.corrections) != len(self.corrected_ns):
            raise ValueError(
                f"has {len(self.corrections)} corrections, but {len(self.corrected_ns)} timestamps in "
                "corrected_ns; send one for each"
            )
        return self


class Object3D(Record):
    """One object's box. centre, size: (3,) m. rotation: (3, 3), columns = the box's axes. World frame.

    views: by default keyframes that see it. points: pixels of its segments, summed over these, not points of the map.
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
            raise ValueError(f"is {size.tolist()}; side lengths must not be negative")
        return size


class Objects(Message):
    """All objects known after `frame_count` fused frames. up: (3,) the supporting planes' normal, world.

    complete: the source's stream has ended, and these are the objects of all its frames. Since 1.1, left_out:
    candidates that are no objects, counted by reason (`... in a keyframe`: counts of the segments stage for single
    keyframes, summed over all, and segments of these that have no vote); keyframes_dropped: keyframes forgotten because
    there were too many, and with them what no other keyframe shows. Since 1.2, epoch: of their map; an object's number
    is valid within one epoch.
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
    """What has changed in the 3D heatmap since the asker's last answer; the answer to `fusion/changes`.

    The query's parameters: `generation` and `since` of the last answer (none: everything), `limit`: maximum number of
    points. generation: another number is another map, of which the asker has nothing yet. cursor: the next query's
    `since`. behind: changed points that did not fit into this answer; ask again.
    number: (N,) uint32, permanent number of the point. xyz: (N, 3) float32 m, world. rgb: (N, 3) uint8. heat: (N,)
    uint8 255ths of the pseudo-average confidence. frequency: (N,) uint32 frames that saw the point, 0 = it is removed.
    planes: (p, 4) float64 [n_x, n_y, n_z, b], world, metres, n.x + b = 0: supporting planes seen recently.
    Since 1.1, epoch: of the map, as in Objects: a restarted fusion continues with the objects of its epoch.
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
