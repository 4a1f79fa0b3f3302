"""A Zenoh router in this process, for hosts where none runs."""

import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import zenoh

from spot3d.dataflow.lingering import disable_linger
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings

_ONLOOKERS = [
    {
        "id": "onlookers",
        "messages": ["put"],
        "key_exprs": ["**"],
        "link_protocols": ["tcp", "tls", "ws", "quic"],
        "flows": ["egress"],
        "overwrite": {"congestion_control": "drop"},
    }
]


def free_loopback_endpoint() -> str:
    """An endpoint of this host only, at a port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def open_router(
    listen: tuple[str, ...],
    connect: tuple[str, ...] = (),
    link: LinkSettings | None = None,
    access: Mapping[str, object] | None = None,
    spare: bool = False,
) -> Iterator[zenoh.Session]:
    """Routes between the clients at `listen` (and the routers at `connect`) for as long as it is open.

    link: its certificates are used at tls endpoints. access: Zenoh's `access_control`; None: everybody may do
    everything. spare: clients that are not connected by a Unix socket are sent what their connection takes, and the
    rest is dropped, so that nobody waits for them. The session takes part in the dataflow as any other does, whatever
    `access` says. Its end does not wait for stalled clients.
    Raises ConnectionError where it cannot listen, TlsError where its certificate cannot be used.
    """
    secrets = {} if link is None else link.model_dump(include={"ca", "certificate", "key", "verify_names"})
    more: dict[str, object] = {} if access is None else {"access_control": access}
    if spare:
        more["qos/network"] = _ONLOOKERS
    with open_session(LinkSettings(mode="router", listen=listen, connect=connect, **secrets), None, more) as session:
        try:
            yield session
        finally:
            disable_linger(all_hosts=True)
