"""Settings of the bridge over a thin link."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from spot3d.dataflow.settings import Endpoint
from spot3d_schemas import STAGES


def _known(stage: str) -> str:
    if stage not in STAGES:
        raise ValueError(f"there is no such stage; there are {', '.join(STAGES)}")
    return stage


class BridgeSettings(BaseModel):
    """Where the other side is, what is on this one, and when the link counts as gone."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ground: tuple[Endpoint, ...] = Field(
        ("tcp/ground-station:7447",), description="the router on the other side of the link; tried for ever"
    )
    stages: tuple[Annotated[str, AfterValidator(_known)], ...] = Field(
        ("source", "pose", "proposals", "heatmap"), description="stages on this side; all others are on the other one"
    )
    silence_s: float = Field(
        0.6,
        gt=0,
        description="without an echo from the other side for this long, new connections are tried beside the old ones, "
        "which TCP may leave waiting for seconds after the link is back",
    )
    attempt_s: float = Field(
        1.0, gt=0, description="longest that connecting may take where the other side answers, seconds"
    )
