"""Settings of the dashboard."""

from pydantic import BaseModel, ConfigDict, Field


class DashboardSettings(BaseModel):
    """Where the page is served, and what it may cost."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = Field(
        "127.0.0.1", description="address that the page is served on; 0.0.0.0: to the network, without a password"
    )
    port: int | None = Field(
        None, ge=0, le=65535, description="port of the page; none: 8080, or the next free one if it is taken"
    )
    map_rate: float = Field(1.0, gt=0, le=100, description="most of the map that is asked for, MB a second and robot")
    points_max: int = Field(
        1_000_000, ge=1000, le=20_000_000, description="most points of a map that are kept and shown; 24 bytes each"
    )
