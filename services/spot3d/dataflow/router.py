"""A router of ours, for hosts where no Zenoh router runs."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings


def free_loopback_endpoint() -> str:
    """An endpoint on this host alone, at a port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def open_router(listen: tuple[str, ...], connect: tuple[str, ...] = ()) -> Iterator[zenoh.Session]:
    """Routes between the clients at `listen` (and the routers at `connect`) for as long as it is open.

    The session takes part in the dataflow as any other does. Raises zenoh.ZError where it cannot listen.
    """
    with open_session(LinkSettings(mode="router", listen=listen, connect=connect)) as session:
        yield session
