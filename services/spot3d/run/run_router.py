"""The router where the stages of a run connect, and other programs."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import zenoh

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.run.display import Watcher
from spot3d.run.socket_folder import stages_socket
from spot3d.security.access import access_control
from spot3d.settings import Settings


@contextmanager
def open_run_router(
    settings: Settings, listen: tuple[str, ...], usual: str | None, apart: bool, watcher: Watcher
) -> Iterator[tuple[zenoh.Session, str]]:
    """The session of a run's router, and the endpoint of its stages, for as long as the block is entered.

    listen: endpoints for other programs. usual: one more, left out if it is taken. apart: if other programs can connect
    at all, the stages use a Unix socket, and no stage waits for anyone else.
    Raises ConnectionError where it cannot listen, TlsError where its certificate cannot be used.
    """
    with ExitStack() as stack:
        try:
            # Looking whether it is free would not be enough: another run may begin at the same time.
            endpoints = listen if usual is None else (usual, *listen)
            router = stack.enter_context(_listening(settings, endpoints, apart))
            if usual is not None:
                watcher.on_note(f"status, dashboard and record can reach this run at {usual}")
        except ConnectionError as refused:
            if usual is None:
                raise
            router = stack.enter_context(_listening(settings, listen, apart))
            # All is well without the usual endpoint: it was to blame.
            why = f"{usual} is in use" if "in use" in str(refused) else str(refused)
            watcher.on_event(f"{why}: other programs can reach this run only at endpoints given with --listen")
        yield router


@contextmanager
def _listening(settings: Settings, listen: tuple[str, ...], apart: bool) -> Iterator[tuple[zenoh.Session, str]]:
    access = access_control(settings.access) if settings.access.enabled else None
    with ExitStack() as stack:
        spare, endpoint = apart and bool(listen), free_loopback_endpoint()
        if spare:
            endpoint = f"unixsock-stream/{stack.enter_context(stages_socket())}"
        router = open_router((endpoint, *listen), link=settings.link, access=access, spare=spare)
        yield stack.enter_context(router), endpoint
