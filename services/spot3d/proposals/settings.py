"""Settings of the proposals stage: the symbols are those of EdgeBoxes (Zitnick and Dollar, ECCV 2014)."""

from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field


class EdgeSettings(BaseModel):
    """How colour and depth become one thin edge map with magnitudes in [0, 1]."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    min_magnitude: float = Field(0.2, gt=0, lt=1, description="edges weaker than this are no edges")
    colour_weight: float = Field(
        0.5, ge=0, le=1, description="largest magnitude of a colour edge in a frame that has depth"
    )
    colour_contrast: float = Field(
        20.0, gt=0, description="colour gradient that counts as a full edge, grey levels per pixel"
    )
    jump_slope: float = Field(
        6.0,
        gt=0,
        description="depth jump that counts as a full edge: tangent of the angle between viewing ray and "
        "normal of a surface that would bridge it (6: 80 degrees)",
    )
    crease_slope: float = Field(
        1.0, gt=0, description="bend that counts as a full edge: change of that tangent across it"
    )
    convex_weight: float = Field(
        0.5,
        ge=0,
        le=1,
        description="weight of convex bends (within objects) against concave ones (between them)",
    )
    noise_gate: float = Field(
        3.0, ge=0, description="standard deviations of depth noise that are subtracted from a depth edge"
    )


class ProposalSettings(BaseModel):
    """How many boxes, how they are searched for and which sizes they may have."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    PAPER: ClassVar[Self]

    max_boxes: int = Field(1000, ge=1, le=10_000, description="M, number of proposals a frame")
    alpha: float = Field(0.5, gt=0, lt=1, description="alpha, IoU of neighbouring windows of the search")
    beta: float = Field(0.75, gt=0, le=1, description="beta, IoU above which the weaker of two boxes is dropped")
    eta: float = Field(1.0, gt=0, le=1, description="eta, factor on beta after each kept box (1: beta stays)")
    min_score: float = Field(0.01, ge=0, description="boxes of a lower score are not proposals")
    edge_merge_threshold: float = Field(
        0.5, gt=0, description="sum of orientation differences in a group, units of pi (the paper's pi/2)"
    )
    cluster_min_magnitude: float = Field(
        1.0, ge=0, description="groups of a lower sum of magnitudes join their neighbours"
    )
    max_aspect_ratio: float = Field(3.0, ge=1, le=20, description="largest ratio of a window's sides")
    min_box_area: float = Field(1000.0, ge=16, description="smallest window at 640x480, square pixels")
    gamma: float = Field(3.0, gt=0, description="gamma, exponent of the affinity of two edge groups")
    kappa: float = Field(1.5, gt=0, description="kappa, exponent of the window's size that the score is divided by")
    refined: int = Field(150, ge=0, le=1_000_000, description="how many of the best windows of the search are refined")
    search_width: int = Field(
        320, ge=40, description="larger images are searched at about this many pixels across: faster, and calmer edges"
    )
    metric_culling: bool = Field(
        True, description="skip windows that the hard filter (paper, Sec. III-C, Eq. 4) would reject anyway"
    )
    min_size: float = Field(0.02, ge=0, description="epsilon_min, smallest cross-section, metres")
    max_size: float = Field(1.0, gt=0, description="epsilon_max, largest cross-section, metres")
    edges: EdgeSettings = EdgeSettings()


# EdgeBoxes' own values, but for the last step of the refinement (`windows.FINEST`); every window of the search that
# scores is refined, none is culled by its metric size.
ProposalSettings.PAPER = ProposalSettings(
    alpha=0.65,
    cluster_min_magnitude=0.5,
    gamma=2.0,
    refined=200_000,
    search_width=4096,
    metric_culling=False,
    edges=EdgeSettings(min_magnitude=0.1),
)
