"""Settings of the proposals stage: the symbols are those of EdgeBoxes (Zitnick and Dollar, ECCV 2014)."""

from pydantic import BaseModel, Field

from spot3d.object_size import SIZE_MAX, SIZE_MIN, SizeMax


class EdgeSettings(BaseModel, frozen=True, extra="forbid"):
    """How colour and depth become one thin edge map with magnitudes in [0, 1]."""

    depth: bool = Field(
        True, description="use edges of depth beside those of colour; off: colour alone, at full weight"
    )
    min_magnitude: float = Field(0.2, gt=0, lt=1, description="weaker edges are ignored; magnitudes are in [0, 1]")
    colour_contrast: float = Field(
        20.0,
        ge=1,  # what eight bits resolve
        le=1000,  # no gradient is as large
        description="colour gradient of an edge of magnitude 1, grey levels per pixel",
    )


class ProposalSettings(BaseModel, frozen=True, extra="forbid"):
    """How many boxes, how they are searched for and which sizes they may have."""

    max_boxes: int = Field(1000, ge=1, le=10_000, description="M: largest number of proposals per frame")
    alpha: float = Field(
        0.5,
        gt=0,
        le=0.9,  # 0.95 takes a gigabyte of windows
        description="alpha: IoU of neighbouring windows of the search",
    )
    beta: float = Field(0.75, gt=0, le=1, description="beta: IoU above which the weaker of two boxes is dropped")
    apart: float = Field(
        0.5,
        gt=0,
        le=1,
        description="boxes with a larger IoU with a better box come after all others, since they show the same "
        "object; 1: order by score alone (EdgeBoxes)",
    )
    cluster_min_magnitude: float = Field(
        1.0, ge=0, description="edge groups with a smaller sum of magnitudes are merged into their neighbours"
    )
    min_box_area: float = Field(1000.0, ge=16, description="smallest window at 640x480, square pixels")
    scaled_area: bool = Field(
        True, description="scale min_box_area with the size of the searched image; off: pixels of that image"
    )
    gamma: float = Field(3.0, gt=0, description="gamma: exponent of the affinity of two edge groups")
    refined: int = Field(150, ge=0, le=1_000_000, description="number of the search's best windows that are refined")
    finest: int = Field(
        24,
        ge=0,
        le=1000,
        description="a window's sides are refined in steps down to its size divided by this; 0: down to three pixels "
        "(EdgeBoxes)",
    )
    search_width: int = Field(
        320, ge=40, description="larger images are searched at about this width, pixels: faster, and edges are smoother"
    )
    metric_culling: bool = Field(
        True, description="skip windows that the hard filter (paper, Sec. IV-C, Eq. 5) would reject anyway"
    )
    size_min: float = Field(SIZE_MIN, ge=0, description="epsilon_min: smallest cross-section, metres")
    size_max: SizeMax = Field(SIZE_MAX, gt=0, description="epsilon_max: largest cross-section, metres")
    edges: EdgeSettings = EdgeSettings()


# The paper's 2D proposals (Sec. III): EdgeBoxes on colour alone, at full size, with the values of Zitnick and Dollar's
# own release; every window that scores is refined, and none is left out for its metric size. What differs is the edge
# detector: theirs is learned, and its model is not available here, so that the edges are thinned colour gradients.
# Their least magnitude, 0.1, is one of sharp edges. With a contrast of 20, 40, 80, 160 grey levels per pixel the 100
# best boxes detect 0.86, 0.86, 0.90, 0.79 of the objects of OSD's learning split and 0.27, 0.69, 0.75, 0.71 of HOTS'.
PAPER = ProposalSettings(
    max_boxes=1000,
    alpha=0.65,
    beta=0.75,
    apart=1.0,
    cluster_min_magnitude=0.5,
    min_box_area=1000.0,
    scaled_area=False,
    gamma=2.0,
    refined=1_000_000,
    finest=0,
    search_width=100_000,
    metric_culling=False,
    edges=EdgeSettings(depth=False, min_magnitude=0.1, colour_contrast=80.0),
)
