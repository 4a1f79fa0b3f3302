"""Settings of the fusion stage."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from spot3d.depth_noise import GRAZING_COS, RANGE_MAX, GrazingCos
from spot3d.object_size import SIZE_MAX, SIZE_MIN, SizeMax
from spot3d.zero_or_at_least import zero_or_at_least

Vote = Literal["parts", "disputed", "outline", "rounded", "balance", "gone"]
"""A rule of the views' consensus that can be left out, to measure what it is worth."""

MAP_ALONE = "; map alone"
"""Marks settings without influence on the objects of the views' consensus. They act on the map that is kept and shown
beside these, and in the paper's method, which finds objects in the map."""


class FusionSettings(BaseModel, frozen=True, extra="forbid"):
    """Plane removal, registration, point selection, clustering and boxes (paper, Sec. V)."""

    plane_distance: float = Field(
        0.005,
        ge=1e-4,  # no depth camera measures finer
        le=0.1,  # objects are not much larger
        description="eps_p: largest distance of a point from a plane that it lies on, metres",
    )
    plane_triples: int = Field(
        10_000,
        ge=10,
        le=100_000,  # with "triples" each is counted on all points
        description="number of triples of neighbouring pixels that RANSAC tries" + MAP_ALONE,
    )
    plane_candidates: int = Field(
        5, ge=1, le=20, description="number of dominant planes of which heat selects the support" + MAP_ALONE
    )
    plane_search: Literal["refined", "triples"] = Field(
        "refined",
        description="refined: known planes and a tenth of the triples, ranked on samples of the points and fitted to "
        "their inliers; triples: planes through three points, counted on all points, at every keyframe "
        "(the paper: at the first)" + MAP_ALONE,
    )
    plane_heat_max: float = Field(
        0.5,
        gt=0,
        le=1,
        description=(
            "planes with a higher mean heat are faces of objects, not supports; 1: heat alone decides (the paper)"
        )
        + MAP_ALONE,
    )
    keyframe_interval: int = Field(
        10, ge=1, description="number of frames between two estimates of the supporting plane" + MAP_ALONE
    )
    plane_pixels: Literal["own", "keyframe"] = Field(
        "own",
        description="pixels that lose their heat in frames after a keyframe: own: the frame's own on the supporting "
        "plane; keyframe: those onto which the keyframe's points on it project (the paper)" + MAP_ALONE,
    )
    plane_removal: bool = Field(True, description="remove supporting planes; off: ablation noPlRem" + MAP_ALONE)

    colour_gate: float = Field(
        0.2, gt=0, description="eps_I: largest colour difference of matching pixels, RGB in [0, 1], L2 norm" + MAP_ALONE
    )
    depth_gate: float = Field(
        0.01, gt=0, description="eps_Z: largest depth difference of matching pixels, metres" + MAP_ALONE
    )
    noise_gate: float = Field(
        3.0, ge=0, le=10, description="least width of the gates, in standard deviations of the depth noise" + MAP_ALONE
    )
    grazing_cos: GrazingCos = GRAZING_COS
    lattice_width: int = Field(
        320,
        ge=40,
        description="number of samples across 58 degrees of view at which a frame is fused; each is the mean of "
        "its block",
    )
    noise_weighting: bool = Field(
        True,
        description="weight samples in running means by 1 / sigma^2 of their depth; off: plain means (the paper)"
        + MAP_ALONE,
    )
    look_up: bool = Field(
        True,
        description="match pixels without a match in the last frame to the map point in their voxel; off: each adds "
        "a point (the paper), and only map_limit bounds the map" + MAP_ALONE,
    )
    speed_max: float = Field(
        20.0,
        gt=0,
        description="highest plausible speed of the camera, m/s; a frame whose pose implies more is not fused",
    )
    voxel: float = Field(
        0.005, gt=0.001, le=0.1, description="edge of the look-up voxels of map points, metres" + MAP_ALONE
    )
    map_limit: int = Field(
        2_000_000, ge=1000, le=20_000_000, description="largest number of points of the 3D heatmap" + MAP_ALONE
    )
    keyframe_limit: int = Field(
        200, ge=1, le=10_000, description="number of latest keyframes whose segments are kept; each takes 0.2 MB"
    )
    range_max: float = Field(
        RANGE_MAX,
        gt=0,
        description="largest depth that is fused, metres (noise exceeds half of eps_min beyond 2.5 m); keyframes "
        "have no vote beyond it (see segments.range_max)",
    )

    frequency_min: int = Field(
        5,
        ge=1,
        description="least number of frames that see a point that is kept; at most frequency_share of all frames"
        + MAP_ALONE,
    )
    frequency_share: float = Field(
        0.05, ge=0, le=1, description="upper limit of frequency_min, as a fraction of all frames" + MAP_ALONE
    )
    tau: float = Field(
        10.0,
        ge=0,
        description="tau: pseudo-count of frames that favours points seen more often; at most tau_share of all frames"
        + MAP_ALONE,
    )
    tau_share: float = Field(
        0.05,
        ge=0,
        le=1,
        description="upper limit of tau and views_tau as a fraction of the frames or keyframes, for short runs; 0: "
        "no limit (the paper)",
    )
    # With 0.18, 0.15, 0.1, 0.05: detection 0.90, 0.92, 0.92, 0.92 on clutter; 0.96, 0.96, 0.95, 0.95 on rendered desks
    # from near, with 0.8, 0.8, 1.0, 1.0 boxes of no object. Redkitchen has 23 boxes with 0.15, 29 and 38 with the next
    # two: of walls and shelves. Objects that few views show need less (see `consensus`).
    heat_min: float = Field(
        0.15, ge=0, le=1, description="eps: least pseudo-average confidence of the points and objects that are kept"
    )

    clustering: Literal["density", "consensus"] = Field(
        "consensus",
        description="consensus: segments of keyframes, joined where most views agree; settings marked `map alone` do "
        "not affect it. density: threshold, K-means over the keyframes' planes, their removal, DBSCAN, "
        "merging, volume (the paper)",
    )
    density_radius: float = Field(
        0.02,
        gt=0,
        le=0.2,  # DBSCAN holds all pairs of points that are nearer
        description="DBSCAN's radius, metres" + MAP_ALONE,
    )
    density_points: int = Field(
        20, ge=1, description="least number of neighbours of a core point of DBSCAN" + MAP_ALONE
    )
    density_cell: Annotated[float, zero_or_at_least(1e-3)] = Field(
        0.005,
        ge=0,
        le=0.1,
        description="edge of cells whose points DBSCAN takes as one at their mean, weighted by their number, metres; "
        "0: every point (the paper)" + MAP_ALONE,
    )
    object_interval_s: float = Field(0.4, gt=0, description="capture time between two updates of the objects, seconds")
    views_min: int = Field(
        3, ge=1, description="least number of keyframes that must see an object; all of them, if there are fewer"
    )
    views_tau: float = Field(
        1.0,
        ge=0,
        description="tau of an object's confidence, in keyframes (one for about 10 frames); at most `tau_share` "
        "of the keyframes",
    )
    object_share: float = Field(
        0.3, ge=0, le=1, description="least share of the keyframes that see an object which must see it as an object"
    )
    skipped: tuple[Vote, ...] = Field(
        (),
        description="rules of the consensus to leave out, for ablations: what most views see as part of something "
        "larger joins it (parts); points that most views see elsewhere are removed (disputed); what "
        "lacks depth extends to its outline in colour (outline); surfaces of revolution are completed "
        "(rounded); what is too thin to stand joins what it stands on (balance); what the latest "
        "keyframes look through is removed (gone)",
    )
    size_min: float = Field(
        SIZE_MIN,
        ge=0,
        description="least second-longest edge of an object, metres; it may be shorter by `plane_distance`",
    )
    size_max: SizeMax = Field(SIZE_MAX, gt=0, description="greatest longest edge of an object, metres")
    volume_min: float = Field(1e-6, ge=0, description="least volume of a box, cubic metres; smaller ones are dropped")
    seed: int = Field(0, ge=0, description="seed of RANSAC's choice of triples" + MAP_ALONE)


PAPER = FusionSettings(
    plane_distance=0.005,
    plane_triples=10_000,
    plane_candidates=5,
    plane_search="triples",
    plane_heat_max=1.0,
    keyframe_interval=10,
    plane_pixels="keyframe",
    colour_gate=0.05,
    depth_gate=0.01,
    noise_gate=0.0,
    grazing_cos=0.0,
    noise_weighting=False,
    look_up=True,
    voxel=0.005,
    map_limit=2_000_000,
    lattice_width=100_000,
    range_max=1000.0,
    frequency_min=5,
    frequency_share=0.05,
    tau=10.0,
    tau_share=0.0,
    heat_min=0.25,
    clustering="density",
    density_radius=0.02,
    density_points=50,
    volume_min=1e-6,
)
"""The paper's method (Sec. V) with its values (Sec. VI-A); no camera measures depth up to that range_max.

Departs from the paper: a surface that comes into view again finds its points by voxel. Otherwise every pixel without a
match adds a point, a tenth to a quarter of each frame's, without end.
"""
