"""The messages of the world: where the camera is, the objects, and the map."""

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
from spot3d_schemas.header import Record
from spot3d_schemas.limits import (
    MAX_BEND,
    MAX_CORRECTIONS,
    MAX_OBJECTS,
    MAX_OBJECTS_BYTES,
    MAX_OBJECTS_VALUES,
)
from spot3d_schemas.message import Message


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
    keyframes, added up over all, and which of their segments have no vote); keyframes_dropped: keyframes that were
    forgotten because there were too many, and with them what no other keyframe shows. Since 1.2, epoch: of the map that
    they are from; the numbers of objects mean the same in one epoch alone.
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
