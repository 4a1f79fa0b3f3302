"""Settings of the links between the stages."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from spot3d_schemas import checked_name

_ENDPOINT = re.compile(
    r"unixsock-stream/\S+|(tcp|tls|quic|ws)/(?P<host>\[[^]\s]+]|[^][:/\s]+):(?P<port>[0-9]+)([?#]\S*)?", re.ASCII
)
_PORT_MAX = 65535
USUAL_ENDPOINT = "tcp/127.0.0.1:7447"
"""Default endpoint, where routers listen and everybody else looks for one."""


def _checked_endpoint(text: str) -> str:
    match = _ENDPOINT.fullmatch(text)
    if match is None or int(match["port"] or 0) > _PORT_MAX:
        raise ValueError(
            f"expected tcp/ADDRESS:PORT with a port up to {_PORT_MAX}, as {USUAL_ENDPOINT} (or tls, quic, ws), or "
            "unixsock-stream/PATH"
        )
    return text


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint: ::1 and 7447 of tls/[::1]:7447#so_sndbuf=65536. Raises ValueError without one."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or match["host"] is None:
        raise ValueError(f"{endpoint} has no host and port, as tls/192.168.1.2:7447 has")
    return match["host"].strip("[]"), int(match["port"])


Endpoint = Annotated[str, AfterValidator(_checked_endpoint)]


class LinkSettings(BaseModel):
    """How a stage's process reaches the others, and what may be dropped on the way."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Annotated[str, AfterValidator(checked_name)] = Field(
        "robot", description="first part of every key, so that one router serves many robots"
    )
    mode: Literal["client", "peer", "router"] = Field(
        "client", description="client: of the router at `connect`; router: serves the clients at `listen`"
    )
    connect: tuple[Endpoint, ...] = Field((USUAL_ENDPOINT,), description="endpoints to connect to; retried for ever")
    listen: tuple[Endpoint, ...] = Field((), description="endpoints to listen on")
    ca: Path | None = Field(
        None, description="tls: certificate of the authority that signs the others'; none: the public web's authorities"
    )
    certificate: Path | None = Field(None, description="tls: this side's own certificate, PEM (spot3d certificates)")
    key: Path | None = Field(None, description="tls: the private key of `certificate`, PEM")
    verify_names: bool = Field(True, description="tls: a router's certificate must be for the host connected to")
    delivery: Literal["live", "lossless"] = Field(
        "live", description="live: the latest frame wins; lossless: nothing is dropped, the source waits"
    )
    in_flight: int = Field(
        4, ge=1, le=64, description="lossless: most frames sent and not yet answered by fusion's progress"
    )
    credit_timeout_s: float = Field(
        5.0,
        gt=0,
        description="lossless: without progress for this long the frames in flight count as lost; at the end of any "
        "stream, longest wait without a word for what is missing",
    )
    shared_memory: bool = Field(
        True, description="live: images go through shared memory on one host; a stalled reader's are dropped, counted"
    )
    snapshot_interval_s: float = Field(
        10.0,
        ge=0,
        description="fusion keeps a snapshot of its map this often, seconds, and when stopped, to go on from; 0: none",
    )
    snapshot_folder: str = Field(
        "",
        description="where snapshots are kept, in a folder by the robot's name; empty: spot3d in $XDG_STATE_HOME, or "
        "in ~/.local/state",
    )
    thin_link: bool = Field(False, description="compress images, and of heat messages send what fusion looks at")
    jpeg_quality: int = Field(90, ge=1, le=100, description="thin_link: quality of the colour images")
    thin_width: int = Field(
        320, ge=40, description="thin_link: heat is sent on a lattice of about so many samples across, as it is fused"
    )
    thin_depth_share: float = Field(
        0.5,
        ge=0,
        le=2,
        description="thin_link: heat's depth is rounded to steps of this share of its noise, a half adding 1 % to it; "
        "0: lossless",
    )
    thin_heat_levels: int = Field(
        16,
        ge=2,
        le=256,
        description="thin_link: heat in so many levels; 16 are as far apart as heat differs from frame to frame; "
        "256: lossless",
    )
    health_interval_s: float = Field(1.0, gt=0, description="time between two health messages, seconds")
    heartbeat: Path | None = Field(
        None, description="a file that is written with every health message while the stage turns, for a supervisor"
    )

    @model_validator(mode="after")
    def _has_what_tls_needs(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both, or neither")
        if self.certificate is None and any(endpoint.startswith(("tls/", "quic/")) for endpoint in self.listen):
            raise ValueError("who listens at tls/... needs a certificate and its key (spot3d certificates)")
        return self
