"""Settings of the bridge over a thin link."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from spot3d.dataflow.settings import Endpoint
from spot3d_schemas import STAGES


def _known(stage: str) -> str:
    if stage not in STAGES:
        raise ValueError(f"unknown stage; choose from {', '.join(STAGES)}")
    return stage


class BridgeSettings(BaseModel):
    """Where the other side is, what is on this one, and when the link counts as gone."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ground: tuple[Endpoint, ...] = Field(
        ("tcp/ground-station:7447",),
        description="endpoints of the router on the other side of the link; retried until one answers",
    )
    stages: tuple[Annotated[str, AfterValidator(_known)], ...] = Field(
        ("source", "pose", "proposals", "heatmap"),
        description="stages on this side of the link; all others run on the other side",
    )
    silence_s: float = Field(
        0.6,
        ge=0.2,  # one is asked for every 0.1 s
        description="time without an echo from the other side after which new connections are tried beside the old "
        "ones, seconds; TCP may take seconds to resume old ones",
    )
    attempt_s: float = Field(1.0, gt=0, description="longest time to connect once the other side answers, seconds")
