"""Settings of the segments stage."""

import math
from typing import Literal

from pydantic import BaseModel, Field

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


class SegmentsSettings(BaseModel, frozen=True, extra="forbid"):
    """Which frames are keyframes, and how the objects of a keyframe are found (paper, Sec. VI-A, single frames)."""

    enabled: bool = Field(
        True, description='find objects in keyframes; off: no frame is a keyframe (for fusion.clustering = "density")'
    )
    interval_s: float = Field(0.3, ge=0, description="shortest capture time between two keyframes, seconds")
    motion_m: float = Field(
        0.02,
        ge=0,
        description="a frame may become a keyframe once the camera has moved by more than this, metres (or "
        "turned by motion_rad)",
    )
    motion_rad: float = Field(
        math.radians(1.0),
        ge=0,
        description="a frame may become a keyframe once the camera has turned by more than this, radians",
    )
    still_s: float = Field(
        1.0, ge=0, description="time after which a camera that stands still gives another keyframe, seconds"
    )
    recent_frames: int = Field(
        2,
        ge=0,
        le=10,
        description="number of frames of the last second whose depth fills holes in a keyframe's, as on shiny or "
        "dark surfaces; 0: none",
    )
    lattice_width: int = Field(
        320,
        ge=40,
        description="number of samples across 58 degrees of view at which segments are found; the same as "
        "fusion.lattice_width",
    )

    plane_distance: float = Field(
        0.005,
        ge=1e-4,  # no depth camera measures finer
        le=0.1,  # objects are not much larger
        description="eps_p: largest distance of a point from a plane that it lies on, metres",
    )
    plane_triples: int = Field(
        10_000, ge=10, le=100_000, description="number of triples of neighbouring pixels that RANSAC tries"
    )
    plane_candidates: int = Field(
        5, ge=1, le=20, description="number of dominant planes of which heat selects the support"
    )
    noise_gate: float = Field(
        3.0, ge=0, le=10, description="least width of the gates, in standard deviations of the depth noise"
    )
    grazing_cos: GrazingCos = GRAZING_COS
    range_max: float = Field(
        RANGE_MAX,
        gt=0,
        description="largest depth at which objects are found, metres; noise exceeds half of eps_min beyond 2.5 m",
    )
    image_up: Literal["top", "bottom", "left", "right"] = Field(
        "top",
        description="side of the image that is up; a warning names the side that seems to be up if it is another one",
    )
    crease: float = Field(
        9.0,
        gt=0,
        description="surfaces are split where their concavity (range times mean curvature) is above this; parts of "
        "one colour, above three times this",
    )
    region: float = Field(
        1.5e-3,
        gt=0,
        le=0.05,  # a fifth of the range across: every object would join its neighbour
        description="least area of a region between creases, as a fraction of the squared range (15 cm2 at 1 m), or "
        "15 cm2 if that is less; smaller ones join a neighbour",
    )
    heat_min: float = Field(
        0.05, ge=0, le=1, description="least mean confidence of a segment; far below eps, since views have yet to vote"
    )
    height_min: float = Field(
        0.01, ge=0, description="least height above the support, metres; what is lower counts as noise or glare"
    )
    size_min: float = Field(
        SIZE_MIN,
        ge=0,
        description="eps_min: objects that show less area than a cube of this edge seen obliquely from above are "
        "left out, metres; their lowest 5 mm count as support",
    )
    size_max: SizeMax = Field(SIZE_MAX, gt=0, description="eps_max: an object's longest edge is at most this, metres")
    skipped: tuple[Step, ...] = Field(
        (),
        description="steps to leave out, for ablations: removal of supports and other planes (support), their bend "
        "(bend), foreground beside the support (beside), lower supports (levels), cooling of walls "
        "(walls); joining of parts of one colour (colour), of vessels (vessels), of torn surfaces "
        "(torn), of fragments (fragments), of partly hidden parts (occluded), of hanging parts "
        "(hanging), of parts in another's box (contained), across holes of their colour, which are filled then "
        "(holes)",
    )
    seed: int = Field(0, ge=0, description="seed of RANSAC's choice of triples")


PAPER = SegmentsSettings(enabled=False, plane_distance=0.005, noise_gate=0.0, grazing_cos=0.0, recent_frames=0)
"""The paper's values (Sec. VI-A). Its fusion clusters only the map's points."""
