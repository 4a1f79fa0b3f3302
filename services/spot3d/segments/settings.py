"""Settings of the segments stage."""

import math

from pydantic import BaseModel, ConfigDict, Field


class SegmentsSettings(BaseModel):
    """Which frames are keyframes, and how the objects of one are found (paper, Sec. V-A, single frames)."""

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
    lattice_width: int = Field(
        320, ge=40, description="segments are found at about this many samples across, as fused ones"
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
    range_max: float = Field(
        2.5, gt=0, description="depth beyond this, where noise exceeds half of eps_min, shows no objects, metres"
    )
    heat_min: float = Field(0.18, ge=0, le=1, description="eps: mean confidence from which something is kept")
    seed: int = Field(0, ge=0, description="seed of RANSAC's choice of triples")


PAPER = SegmentsSettings(enabled=False, plane_distance=0.005, noise_gate=0.0, lattice_width=640, heat_min=0.25)
"""The paper's values (Sec. V-A). Its fusion clusters the map's points alone."""
