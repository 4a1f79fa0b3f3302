"""Settings of the pose stage. The defaults are the preset for depth cameras indoors."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class PoseSettings(BaseModel):
    """Pose provider, its point selection and registration, and when tracking counts as lost."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    provider: Literal["kiss", "gicp", "given"] = Field(
        "kiss",
        description="kiss: KISS-ICP refined against a local map of planes; gicp: generalised ICP "
        "(small_gicp); given: the poses that the frames bring along",
    )

    # Larger values change nothing, as the noise is measured; values below the noise fail (redkitchen, 5 to 20 mm).
    given_sigma: float = Field(
        0.02,
        ge=0,
        le=0.2,
        description="given: how far off the given poses may be, standard deviation of each axis, metres: so far they "
        "are corrected against the map of the frames before; 0: they are taken as they are",
    )
    given_turn_sigma: float = Field(
        0.014, gt=0, le=0.2, description="given: the same of the rotation about each axis, radians"
    )

    given_delay_sigma: float = Field(
        0.03,
        ge=0,
        description="how late given poses may be, or early, standard deviation in seconds; their delay is estimated "
        "from how the camera's velocity and what depth says differ together; 0: they are taken as they are",
    )
    mount_turn_sigma: float = Field(
        0.014,
        ge=0,
        le=0.2,
        description="given: how far the camera may be turned against what the poses are of, standard deviation about "
        "each axis, radians: it is estimated from views at a slant to each other; 0: poses are taken as they are",
    )
    centre_sigma: float = Field(
        0.02,
        ge=0,
        le=0.2,
        description="given: how far off the principal point may be, standard deviation along each axis, focal lengths "
        "(0.02: ten pixels of 640): it is estimated along with the turn; 0: it is taken as it is",
    )
    depth_scale_sigma: float = Field(
        0.02,
        ge=0,
        le=0.1,
        description="given: how true the camera's depth is, standard deviation of its scale: it is estimated against "
        "the given poses, and depth is corrected by what is probable; 0: it is taken as it is",
    )
    depth_bend_sigma: float = Field(
        0.01,
        ge=0,
        le=0.1,
        description="how far depth's scale in a part of the image may be off that of all, standard deviation: cameras "
        "bend what they see alike in all images, so that keyframes can tell; 0: it is taken as it is",
    )

    lattice_width: int = Field(
        128,
        ge=40,
        le=640,
        description="surface points are sampled at up to this many columns, each a plane fit",
    )
    range_max: float = Field(4.0, gt=0, le=20, description="depth beyond this is not used, metres")
    surfel_limit: int = Field(100_000, ge=1000, le=2_000_000, description="most surfels; the longest unseen half goes")

    landmark_interval: float = Field(
        0.045, ge=0, description="least time between two frames that are compared with landmarks, seconds"
    )
    features: int = Field(500, ge=50, le=5000, description="image features looked for in a frame")
    landmark_limit: int = Field(20_000, ge=1000, le=250_000, description="most landmarks; those known last stay")

    weakness_max: float = Field(
        1.0,
        gt=0,
        description="largest standard deviation of the pose in its least constrained direction, if the noise of the "
        "points were independent, as a multiple of that noise (metres; radians at 1 m): a bare wall holds no pose",
    )
    speed_max: float = Field(3.0, gt=0, description="fastest plausible camera, m/s")
    turn_max: float = Field(5.0, gt=0, description="fastest plausible turn, rad/s")
