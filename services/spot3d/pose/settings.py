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

    # Larger changes nothing, for the noise is measured; smaller than the noise fails (redkitchen, 5 to 20 mm).
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
    fill_min: float = Field(0.8, gt=0, le=1, description="share of valid pixels that a plane fit needs")
    grazing_cos: float = Field(
        0.26, ge=0, lt=1, description="smallest cosine between viewing ray and normal of a surface point"
    )
    flatness: float = Field(
        2.0, gt=0, description="largest residual of a plane fit, in standard deviations of the depth noise"
    )

    kiss_voxel: float = Field(0.10, gt=0.01, le=2, description="KISS-ICP voxel size, metres")
    kiss_points_per_voxel: int = Field(3, ge=1, le=50, description="KISS-ICP points kept in a voxel")
    kiss_iterations: int = Field(10, ge=1, le=500, description="KISS-ICP iterations at most")
    kiss_convergence: float = Field(
        3e-3, gt=0, description="KISS-ICP ends when a step is smaller than this (metres and radians)"
    )
    kiss_initial_threshold: float = Field(0.05, gt=0, description="KISS-ICP sigma_0: first adaptive threshold, metres")
    kiss_min_motion: float = Field(
        0.005, gt=0, description="KISS-ICP delta_min: smaller deviations do not adapt the threshold, metres"
    )

    surfel_voxel: float = Field(0.05, gt=0.005, le=0.5, description="edge of a voxel of the plane map, metres")
    surfel_limit: int = Field(100_000, ge=1000, le=2_000_000, description="most surfels; the longest unseen half goes")
    map_range: float = Field(20.0, gt=1, description="KISS-ICP map beyond this from the camera goes, metres")
    refine_iterations: int = Field(8, ge=0, le=50, description="Gauss-Newton steps against the plane map")
    refine_distance: float = Field(0.05, gt=0, description="largest distance between a point and its plane, metres")
    refine_kernel: float = Field(
        4.5, gt=0, description="scale of the robust kernel, in standard deviations of the depth noise"
    )

    landmarks: bool = Field(True, description="kiss, gicp: correct the odometry's drift by visual landmarks")
    landmark_interval: float = Field(
        0.045, ge=0, description="least time between two frames that are compared with landmarks, seconds"
    )
    features: int = Field(500, ge=50, le=5000, description="image features looked for in a frame")
    landmark_limit: int = Field(20_000, ge=1000, le=250_000, description="most landmarks; those known last stay")

    gicp_downsampling: float = Field(0.03, gt=0.005, le=1, description="gicp: voxel of the source points, metres")
    gicp_voxel: float = Field(0.08, gt=0.01, le=2, description="gicp: voxel of the map of Gaussians, metres")
    gicp_distance: float = Field(0.10, gt=0.01, description="gicp: largest correspondence distance, metres")
    gicp_iterations: int = Field(20, ge=1, le=200, description="gicp: iterations at most")

    points_min: int = Field(300, ge=20, description="fewer surface points than this: lost")
    overlap_min: float = Field(0.5, ge=0, le=1, description="share of points that must meet the map while tracking")
    recovery_overlap_min: float = Field(
        0.7,
        ge=0,
        le=1,
        description="the same after a loss, where a false match is likelier",
    )
    recovery_distance: float = Field(
        0.02, gt=0, description="largest distance of a point that meets the map, to be found again, metres"
    )
    recovery_margin: float = Field(
        0.1,
        ge=0,
        le=1,
        description="overlap by which the place found must beat any other place",
    )
    residual_max: float = Field(
        0.015, gt=0, description="root mean square distance of the matched points to the map, metres"
    )
    weakness_max: float = Field(
        1.0,
        gt=0,
        description="largest standard deviation of the pose in its least constrained direction, if the noise of the "
        "points were independent, as a multiple of that noise (metres; radians at 1 m): a bare wall holds no pose",
    )
    speed_max: float = Field(3.0, gt=0, description="fastest plausible camera, m/s")
    turn_max: float = Field(5.0, gt=0, description="fastest plausible turn, rad/s")
    recovery_attempts: int = Field(
        12, ge=1, le=12, description="starting poses tried for one frame while lost: bounds its time"
    )
