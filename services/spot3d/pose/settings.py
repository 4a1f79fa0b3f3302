"""Settings of the pose stage. The defaults are the preset for depth cameras indoors."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class PoseSettings(BaseModel):
    """Pose provider, its point selection and registration, and when tracking counts as lost."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    provider: Literal["kiss", "gicp", "given"] = Field(
        "kiss",
        description="kiss: KISS-ICP refined against a local map of planes; gicp: generalised ICP (small_gicp); "
        "given: poses from the input",
    )

    # Larger values change nothing, as the noise is measured; values below the noise fail (redkitchen, 5 to 20 mm).
    given_sigma: float = Field(
        0.02,
        ge=0,
        le=0.2,
        description="given: largest standard deviation of the poses' position error on each axis, metres; they are "
        "corrected against the map by so much; 0: no correction",
    )
    given_turn_sigma: float = Field(
        0.014,
        gt=0,
        le=0.2,
        description="given: largest standard deviation of the poses' rotation error about each axis, radians",
    )

    given_delay_sigma: float = Field(
        0.03,
        ge=0,
        description="given: standard deviation of the poses' delay against the images, seconds; the delay is "
        "estimated from the motion in poses and depth; 0: not estimated",
    )
    mount_turn_sigma: float = Field(
        0.014,
        ge=0,
        le=0.2,
        description="given: standard deviation of the camera's rotation against the body whose poses are given, "
        "about each axis, radians; it is estimated from views from different sides; 0: not estimated",
    )
    centre_sigma: float = Field(
        0.02,
        ge=0,
        le=0.2,
        description="given: standard deviation of the principal point's error along each axis, in focal lengths "
        "(0.02: about ten pixels of 640); it is estimated with that rotation; 0: not estimated",
    )
    depth_scale_sigma: float = Field(
        0.02,
        ge=0,
        le=0.1,
        description="given: standard deviation of the error of depth's scale, as a fraction; it is estimated against "
        "the given poses, and depth is corrected; 0: not estimated",
    )
    depth_bend_sigma: float = Field(
        0.01,
        ge=0,
        le=0.1,
        description="standard deviation by which depth's scale in a part of the image differs from the mean, as a "
        "fraction; it is estimated from keyframes, and depth is corrected; 0: not estimated",
    )

    lattice_width: int = Field(
        128,
        ge=40,
        le=640,
        description="largest number of image columns at which surface points are sampled; each point is a plane fit",
    )
    range_max: float = Field(4.0, gt=0, le=20, description="depth beyond this is not used, metres")
    surfel_limit: int = Field(
        100_000,
        ge=1000,
        le=2_000_000,
        description="largest number of surfels in the map; beyond it, the half unseen for longest is deleted",
    )

    landmark_interval: float = Field(
        0.045, ge=0, description="shortest time between two frames that are compared with landmarks, seconds"
    )
    features: int = Field(500, ge=50, le=5000, description="largest number of image features per frame")
    landmark_limit: int = Field(
        20_000,
        ge=1000,
        le=250_000,
        description="largest number of landmarks; beyond it, those not recognised for longest are deleted",
    )

    weakness_max: float = Field(
        1.0,
        gt=0,
        description="largest standard deviation of the pose in its least constrained direction (metres; radians at 1 "
        "m), as a multiple of the points' noise; above it, as at a bare wall, the surface does not "
        "constrain the pose",
    )
    speed_max: float = Field(3.0, gt=0, description="highest plausible speed of the camera, m/s")
    turn_max: float = Field(5.0, gt=0, description="highest plausible turn rate of the camera, rad/s")
