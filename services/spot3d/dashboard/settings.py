"""Settings of the dashboard."""

from pydantic import BaseModel, ConfigDict, Field


class DashboardSettings(BaseModel):
    """Where the page is served, and what it may cost."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = Field(
        "127.0.0.1", description="address at which the page is served; 0.0.0.0: on all networks, without a password"
    )
    port: int | None = Field(None, ge=0, le=65535, description="port of the page; none: 8080, or the next free port")
    map_rate: float = Field(1.0, gt=0, le=100, description="highest rate at which the map of a robot is fetched, MB/s")
    points_max: int = Field(
        1_000_000,
        ge=1000,
        le=20_000_000,
        description="largest number of points of a map that are kept and shown, 24 bytes each",
    )
