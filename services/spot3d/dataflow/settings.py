"""Settings of the links between the stages."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from spot3d_schemas import checked_name

# Zenoh panics at another `rel`, and refuses options without a name.
_OPTION = r"(rel=[01]|(?!rel=)[^\s?#;=]+=[^\s?#;]*)"
_OPTIONS = f"{_OPTION}(;{_OPTION})*"
_ENDPOINT = re.compile(
    r"(unixsock-stream/[^\s?#]+|(tcp|tls|quic|ws)/(?P<host>\[[^]\s?#]+]|[^][:/\s?#]+):(?P<port>[0-9]+))"
    rf"(\?{_OPTIONS})?(#{_OPTIONS})?",
    re.ASCII,
)
_PORT_MAX = 65535
USUAL_ENDPOINT = "tcp/127.0.0.1:7447"
"""Default endpoint, where routers listen and everybody else looks for one."""


def _checked_endpoint(text: str) -> str:
    match = _ENDPOINT.fullmatch(text)
    if match is None or int(match["port"] or 0) > _PORT_MAX:
        raise ValueError(
            f"expected tcp/ADDRESS:PORT with a port up to {_PORT_MAX}, such as {USUAL_ENDPOINT} (or tls, quic, ws), "
            "or unixsock-stream/PATH; options may follow as NAME=VALUE, such as #so_sndbuf=65536 or ?rel=1 (0 or 1)"
        )
    return text


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint: ::1 and 7447 of tls/[::1]:7447#so_sndbuf=65536. Raises ValueError without one."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or match["host"] is None:
        raise ValueError(f"{endpoint} has no host and port; give one such as tls/192.168.1.2:7447")
    return match["host"].strip("[]"), int(match["port"])


Endpoint = Annotated[str, AfterValidator(_checked_endpoint)]


class LinkSettings(BaseModel):
    """How a stage's process reaches the others, and what may be dropped on the way."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Annotated[str, AfterValidator(checked_name)] = Field(
        "robot", description="name of the robot, the first part of every key: one router serves many robots"
    )
    mode: Literal["client", "peer", "router"] = Field(
        "client",
        description="client: connects to `connect`; peer: connects to other peers; router: also serves the clients at "
        "`listen`",
    )
    connect: tuple[Endpoint, ...] = Field(
        (USUAL_ENDPOINT,), description="endpoints to connect to; retried until one answers"
    )
    listen: tuple[Endpoint, ...] = Field((), description="endpoints to listen on")
    ca: Path | None = Field(
        None,
        description="tls: certificate of the authority (CA) that signed the others' certificates, PEM; none: public "
        "authorities",
    )
    certificate: Path | None = Field(None, description="tls: this side's own certificate, PEM (spot3d certificates)")
    key: Path | None = Field(None, description="tls: the private key of `certificate`, PEM")
    verify_names: bool = Field(
        True, description="tls: check that a router's certificate is issued for the host connected to"
    )
    delivery: Literal["live", "lossless"] = Field(
        "live",
        description="live: a busy stage skips to the latest frame; lossless: no frame is dropped, and the source waits",
    )
    in_flight: int = Field(
        4, ge=1, le=64, description="lossless: largest number of frames sent but not yet confirmed by fusion"
    )
    credit_timeout_s: float = Field(
        5.0,
        gt=0,
        description="lossless: time without progress after which the frames in flight count as lost, seconds; also "
        "how long fusion waits for missing frames at the end of a stream",
    )
    shared_memory: bool = Field(
        True,
        description="live: pass images through shared memory on one host; images for a stalled reader are "
        "dropped and counted",
    )
    snapshot_interval_s: float = Field(
        10.0,
        ge=0,
        description="time between two snapshots from which fusion and pose resume after a restart, seconds; fusion "
        "also writes one when it ends; 0: none",
    )
    snapshot_folder: str = Field(
        "",
        description="folder for snapshots, with a subfolder for each robot; empty: spot3d in $XDG_STATE_HOME, or in "
        "~/.local/state",
    )
    thin_link: bool = Field(False, description="compress images, and reduce heat messages to what fusion uses")
    jpeg_quality: int = Field(90, ge=1, le=100, description="thin_link: JPEG quality of the colour images, 1 to 100")
    thin_width: int = Field(
        320,
        ge=40,
        description="thin_link: number of samples across the image at which heat is sent; fusion uses as many",
    )
    thin_depth_share: float = Field(
        0.5,
        ge=0,
        le=2,
        description="thin_link: step to which heat's depth is rounded, as a fraction of its noise (0.5 adds 1 % to "
        "the noise); 0: lossless",
    )
    thin_heat_levels: int = Field(
        16,
        ge=2,
        le=256,
        description="thin_link: number of levels of heat; 16 are as far apart as heat differs between frames; "
        "256: lossless",
    )
    health_interval_s: float = Field(
        1.0,
        gt=0,
        le=1,
        description="time between two health messages, and between two heartbeats, seconds; at most 1, since a stage "
        "that is silent for longer is reported to hang",
    )
    heartbeat: Path | None = Field(
        None, description="file for a supervisor, written with every health message unless the stage hangs"
    )

    @model_validator(mode="after")
    def _has_what_tls_needs(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both, or neither")
        if self.certificate is None and any(endpoint.startswith(("tls/", "quic/")) for endpoint in self.listen):
            raise ValueError(
                "listening at tls/... or quic/... needs a certificate and its key; make them with spot3d certificates"
            )
        return self
