"""Settings of the links between the stages."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from spot3d_schemas import checked_name

Endpoint = Annotated[
    str, Field(pattern=r"^(tcp|tls|quic|ws|unixsock-stream)/\S+$", description="e.g. tcp/127.0.0.1:7447")
]


class LinkSettings(BaseModel):
    """How a stage's process reaches the others, and what may be dropped on the way."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Annotated[str, AfterValidator(checked_name)] = Field(
        "robot", description="first part of every key, so that one router serves many robots"
    )
    mode: Literal["client", "peer", "router"] = Field(
        "client", description="client: of the router at `connect`; router: serves the clients at `listen`"
    )
    connect: tuple[Endpoint, ...] = Field(
        ("tcp/127.0.0.1:7447",), description="endpoints to connect to; retried for ever"
    )
    listen: tuple[Endpoint, ...] = Field((), description="endpoints to listen on")
    delivery: Literal["live", "lossless"] = Field(
        "live", description="live: the latest frame wins; lossless: nothing is dropped, the source waits"
    )
    in_flight: int = Field(
        4, ge=1, le=64, description="lossless: most frames sent and not yet answered by fusion's progress"
    )
    credit_timeout_s: float = Field(
        5.0, gt=0, description="lossless: without progress for this long the frames in flight count as lost"
    )
    shared_memory: bool = Field(
        True, description="live: images go through shared memory on one host; a stalled reader's are dropped, counted"
    )
    snapshot_interval_s: float = Field(
        10.0, ge=0, description="fusion keeps a snapshot of its map this often, seconds, to go on from; 0: none"
    )
    snapshot_folder: str = Field(
        "", description="where snapshots are kept; empty: spot3d/ROBOT in $XDG_STATE_HOME, or in ~/.local/state"
    )
    thin_link: bool = Field(False, description="compress images: colour as JPEG, depth and heat lossless")
    jpeg_quality: int = Field(90, ge=1, le=100, description="thin_link: quality of the colour images")
    object_interval_s: float = Field(0.4, gt=0, description="capture time between two updates of the objects, seconds")
    health_interval_s: float = Field(1.0, gt=0, description="time between two health messages, seconds")
