"""Settings of the heatmap stage."""

from typing import Literal

from pydantic import BaseModel, Field

from spot3d.object_size import SIZE_MAX, SIZE_MIN, SizeMax


class HeatmapSettings(BaseModel, frozen=True, extra="forbid"):
    """Thresholds of the depth filters (paper, Sec. IV-B and IV-C)."""

    depth_range_min: float = Field(
        0.5, ge=0, description="eps_delta: depth range above which a proposal's background is masked, metres"
    )
    size_min: float = Field(
        SIZE_MIN, ge=0, description="eps_min: proposals whose width and height are both below this are rejected, metres"
    )
    size_max: SizeMax = Field(
        SIZE_MAX, gt=0, description="eps_max: proposals whose width and height are both above this are rejected, metres"
    )
    size_depth: Literal["middle", "foreground"] = Field(
        "middle",
        description="depth Z_mu at which a proposal's size is measured: middle: midway between its nearest and "
        "farthest depth; foreground: the mean depth of what is not masked (the paper)",
    )
    soft_filter: bool = Field(True, description="mask the background of proposals (off: ablation noSFilt)")
    hard_filter: bool = Field(True, description="reject proposals of implausible size (off: ablation noHFilt)")


PAPER = HeatmapSettings(depth_range_min=0.5, size_depth="foreground", soft_filter=True, hard_filter=True)
"""The paper's values (Sec. VI-A)."""
