"""Settings of the segments stage."""

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from spot3d.depth_noise import GRAZING_COS, RANGE_MAX, GrazingCos
from spot3d.object_size import SIZE_MAX, SIZE_MIN, SizeMax

Step = Literal[
    "support",
    "bend",
    "beside",
    "levels",
    "walls",
    "colour",
    "vessels",
    "torn",
    "fragments",
    "occluded",
    "hanging",
    "contained",
    "holes",
]
"""A step of the finder that can be skipped, for ablations."""


class SegmentsSettings(BaseModel):
    """Which frames are keyframes, and how the objects of a keyframe are found (paper, Sec. VI-A, single frames)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    enabled: bool = Field(
        True,
        description="find objects in keyframes; off: no frame is one, for a fusion that clusters its map alone",
    )
    interval_s: float = Field(
        0.3, ge=0, description="least capture time between two keyframes, seconds: about 3 views a second vote"
    )
    motion_m: float = Field(
        0.02,
        ge=0,
        description="a frame shows something new when the camera has moved by more than this, metres: the least "
        "object's size (eps_min); or ...",
    )
    motion_rad: float = Field(
        math.radians(1.0), ge=0, description="... has turned by more than this, radians: 2 cm at the range of 1.1 m"
    )
    still_s: float = Field(
        1.0, ge=0, description="a camera that stands still is looked through again after this, seconds"
    )
    recent_frames: int = Field(
        2,
        ge=0,
        le=10,
        description="frames of the last second whose depth fills the holes in a keyframe's: what shines or is dark "
        "has depth in one view and none in the next; 0: none",
    )
    lattice_width: int = Field(
        320,
        ge=40,
        description="segments are found at about this many samples across 58 degrees, as fused ones",
    )

    plane_distance: float = Field(
        0.005, gt=0, description="eps_p: distance in metres within which a point lies on a plane"
    )
    plane_triples: int = Field(
        10_000, ge=10, le=1_000_000, description="triples of neighbouring pixels that RANSAC tries"
    )
    plane_candidates: int = Field(5, ge=1, le=20, description="dominant planes among which heat decides")
    noise_gate: float = Field(
        3.0, ge=0, description="gates never close below this many standard deviations of the depth noise"
    )
    grazing_cos: GrazingCos = GRAZING_COS
    range_max: float = Field(
        RANGE_MAX, gt=0, description="depth beyond this, where noise exceeds half of eps_min, shows no objects, metres"
    )
    image_up: Literal["top", "bottom", "left", "right"] = Field(
        "top",
        description="the side of the image that is up, for cameras that are mounted otherwise; where another one seems "
        "to be, that is said",
    )
    crease: float = Field(
        9.0,
        gt=0,
        description="a surface is split where its concavity, the range times the mean curvature, is more than this; "
        "what is of one colour, where it is more than three times this",
    )
    region: float = Field(
        1.5e-3,
        gt=0,
        description="a region between creases of less than this share of the squared range, 15 cm2 at 1 m, has no "
        "reliable shape and joins a neighbour",
    )
    heat_min: float = Field(
        0.05,
        ge=0,
        le=1,
        description="mean confidence from which a segment is kept: far less than eps, since views have yet to vote",
    )
    height_min: float = Field(
        0.01, ge=0, description="what rises less above its support is noise or glare: things of 1.5 cm count, metres"
    )
    size_min: float = Field(
        SIZE_MIN,
        ge=0,
        description="eps_min: an object shows at least what a cube of this edge does from above at an angle, metres; "
        "its lowest 5 mm count as its support",
    )
    size_max: SizeMax = Field(SIZE_MAX, gt=0, description="eps_max: an object's longest edge is at most this, metres")
    skipped: tuple[Step, ...] = Field(
        (),
        description="steps to leave out, for ablations: removal of the support and other planes, its bend, its edge "
        "(what is beside it is not cut where it is high), lower supports, cooling of walls, joining of what is of one "
        "colour, of vessels, of torn surfaces, of fragments, of what something hides in part, of what hangs in the "
        "air, of what lies in another's box, filling of holes",
    )
    seed: int = Field(0, ge=0, description="seed of RANSAC's choice of triples")


PAPER = SegmentsSettings(enabled=False, plane_distance=0.005, noise_gate=0.0, grazing_cos=0.0, recent_frames=0)
"""The paper's values (Sec. VI-A). Its fusion clusters only the map's points."""
