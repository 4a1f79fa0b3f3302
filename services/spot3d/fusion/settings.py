"""Settings of the fusion stage."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from spot3d.depth_noise import GRAZING_COS, RANGE_MAX, GrazingCos
from spot3d.object_size import SIZE_MAX, SIZE_MIN, SizeMax

Vote = Literal["parts", "disputed", "outline", "rounded", "balance", "gone"]
"""A rule of the views' consensus that can be left out, to measure what it is worth."""

MAP_ALONE = "; map alone"
"""Marks settings without influence on the objects of the views' consensus. They act on the map that is kept and shown
beside these, and in the paper's method, which finds objects in the map."""


class FusionSettings(BaseModel):
    """Plane removal, registration, point selection, clustering and boxes (paper, Sec. V)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    plane_distance: float = Field(
        0.005, gt=0, description="eps_p: distance in metres within which a point lies on a plane"
    )
    plane_triples: int = Field(
        10_000, ge=10, le=1_000_000, description="triples of neighbouring pixels that RANSAC tries" + MAP_ALONE
    )
    plane_candidates: int = Field(5, ge=1, le=20, description="dominant planes among which heat decides" + MAP_ALONE)
    plane_search: Literal["refined", "triples"] = Field(
        "refined",
        description="triples: planes through three points each, all points counted, as the paper has it for the first "
        "keyframe, at every one; refined: known planes and a tenth of the triples, ranked on samples of the points, "
        "then fitted to the inliers" + MAP_ALONE,
    )
    plane_heat_max: float = Field(
        0.5,
        gt=0,
        le=1,
        description="a plane hotter than this on average is an object's own face and supports nothing; 1: heat alone "
        "decides (the paper)" + MAP_ALONE,
    )
    keyframe_interval: int = Field(
        10, ge=1, description="frames between two estimates of the supporting plane" + MAP_ALONE
    )
    plane_pixels: Literal["own", "keyframe"] = Field(
        "own",
        description="what loses its heat in a frame after a keyframe: own: what of the frame itself lies on the "
        "supporting plane; keyframe: the pixels that the keyframe's points on it project to (the paper)" + MAP_ALONE,
    )
    plane_removal: bool = Field(True, description="remove supporting planes; off: ablation noPlRem" + MAP_ALONE)

    colour_gate: float = Field(
        0.2, gt=0, description="eps_I: largest colour difference of matching pixels, RGB in [0, 1], L2 norm" + MAP_ALONE
    )
    depth_gate: float = Field(
        0.01, gt=0, description="eps_Z: largest depth difference of matching pixels, metres" + MAP_ALONE
    )
    noise_gate: float = Field(
        3.0, ge=0, description="gates never close below this many standard deviations of the depth noise" + MAP_ALONE
    )
    grazing_cos: GrazingCos = GRAZING_COS
    lattice_width: int = Field(
        320,
        ge=40,
        description="a frame is fused at about this many samples across 58 degrees, each the mean of its block",
    )
    noise_weighting: bool = Field(
        True,
        description="running means weigh a sample by 1 / sigma^2 of its depth; off: plain means (the paper)"
        + MAP_ALONE,
    )
    look_up: bool = Field(
        True,
        description="a pixel that no pixel of the last frame matches finds the point that lies in its voxel; off: it "
        "is a new point (the paper), and only map_limit bounds the map" + MAP_ALONE,
    )
    speed_max: float = Field(
        20.0, gt=0, description="fastest plausible camera, m/s: a pose further off than that is not fused"
    )
    voxel: float = Field(
        0.005, gt=0.001, le=0.1, description="edge of the look-up voxels of map points, metres" + MAP_ALONE
    )
    map_limit: int = Field(
        2_000_000, ge=1000, le=20_000_000, description="most points that the 3D heatmap holds" + MAP_ALONE
    )
    keyframe_limit: int = Field(
        200, ge=1, le=10_000, description="most keyframes whose segments are kept, the latest; 0.2 MB each"
    )
    range_max: float = Field(
        RANGE_MAX,
        gt=0,
        description="depth beyond this, where noise exceeds half of eps_min, is not fused, metres; what a keyframe has "
        "as no object there it does not see: it was not looked for (segments.range_max)",
    )

    frequency_min: int = Field(5, ge=1, description="points seen in fewer frames are dropped, or ..." + MAP_ALONE)
    frequency_share: float = Field(
        0.05, ge=0, le=1, description="... seen in less than this share of the frames, whichever is lower" + MAP_ALONE
    )
    tau: float = Field(10.0, ge=0, description="tau: favours points seen more often; or ..." + MAP_ALONE)
    tau_share: float = Field(
        0.05,
        ge=0,
        le=1,
        description="... this share of the frames, whichever is lower: short runs count too; 0: tau as given (the "
        "paper)",
    )
    # With 0.18, 0.15, 0.1, 0.05: detection 0.90, 0.92, 0.92, 0.92 on clutter; 0.96, 0.96, 0.95, 0.95 on rendered desks
    # from near, with 0.8, 0.8, 1.0, 1.0 boxes of no object. Redkitchen has 23 boxes with 0.15, 29 and 38 with the next
    # two: of walls and shelves. Objects that few views show need less (see `consensus`).
    heat_min: float = Field(0.15, ge=0, le=1, description="eps: pseudo-average confidence from which something is kept")

    clustering: Literal["density", "consensus"] = Field(
        "consensus",
        description="density: threshold, K-means over the keyframes' planes, their removal, DBSCAN, merging, volume, "
        "and no other rule (the paper); consensus: the segments of keyframes, joined where most views agree, in "
        "which what is said to be of the `map alone` has no part",
    )
    density_radius: float = Field(0.02, gt=0, description="DBSCAN's radius, metres" + MAP_ALONE)
    density_points: int = Field(20, ge=1, description="DBSCAN's least neighbours of a core point" + MAP_ALONE)
    density_cell: float = Field(
        0.005,
        ge=0,
        le=0.1,
        description="DBSCAN sees the points of a cell of this edge as one at their mean, with their number as its "
        "weight, metres; 0: every point (the paper)" + MAP_ALONE,
    )
    object_interval_s: float = Field(0.4, gt=0, description="capture time between two updates of the objects, seconds")
    views_min: int = Field(3, ge=1, description="an object is seen in at least so many keyframes, if there are as many")
    views_tau: float = Field(
        1.0,
        ge=0,
        description="tau of an object's confidence, in keyframes, as 10 frames are about one; at most `tau_share` of "
        "them",
    )
    object_share: float = Field(
        0.3, ge=0, le=1, description="share of the keyframes that see an object which must see it as one"
    )
    skipped: tuple[Vote, ...] = Field(
        (),
        description="rules of the consensus to leave out, for ablations: what most views have in one with something "
        "larger is a part of it; points that most views have elsewhere are left out; what lacks depth reaches as far "
        "as its outline; what most views fit a surface of revolution to is round; what is too thin to stand by itself "
        "is a part of what it stands on; what the latest keyframes look through is there no more",
    )
    size_min: float = Field(
        SIZE_MIN, ge=0, description="an object's second longest edge is at least this, less `plane_distance`, metres"
    )
    size_max: SizeMax = Field(SIZE_MAX, gt=0, description="an object's longest edge is at most this, metres")
    volume_min: float = Field(1e-6, ge=0, description="boxes below this volume are dropped, cubic metres")
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
