"""The dashboard's process: serves the page until it is stopped."""

import io
import logging
import os
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, redirect_stdout

import viser

from spot3d.dashboard.free_port import free_port
from spot3d.dashboard.link import Link
from spot3d.dashboard.page import Page
from spot3d.dashboard.settings import DashboardSettings
from spot3d.dataflow.process_use import let_stages_go_first
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals

log = logging.getLogger(__name__)

_STEP_S = 0.05


def run(
    link: LinkSettings,
    settings: DashboardSettings,
    stop: threading.Event | None = None,
    robot: str | None = None,
    always: bool = False,
    on_ready: Callable[[str], None] = lambda _address: None,
) -> None:
    """Serve the page until stopped by `stop`, SIGINT or SIGTERM.

    robot: the one to show first. always: follow the map even without a browser. on_ready: called with the address.
    Raises OSError where the page cannot be served at the address of the settings, or `link` cannot listen.
    """
    with stop_on_signals(stop) as stopped, open_server(settings) as server:
        address = f"http://{'127.0.0.1' if settings.host == '0.0.0.0' else settings.host}:{server.get_port()}"
        serve(server, link, settings, stopped, robot, always, lambda: on_ready(address))


def serve(
    server: viser.ViserServer,
    link: LinkSettings,
    settings: DashboardSettings,
    stop: threading.Event,
    robot: str | None = None,
    always: bool = False,
    on_ready: Callable[[], None] = lambda: None,
) -> None:
    """Show received messages on an open server until `stop` is set. Raises OSError where `link` cannot listen.

    on_ready: called once it listens, or at once where it connects to a router.
    """
    failures = RateLimitedLog(log)
    where = ", ".join(link.listen or link.connect)
    with Link(link, settings.map_rate) as heard, closing(Page(server, heard, settings, where, always)) as page:
        let_stages_go_first()
        on_ready()
        while not stop.wait(_STEP_S):
            if heard.failed is not None:
                raise heard.failed
            try:
                page.step(robot)
            except Exception as error:
                # One robot's messages or one browser's actions must not end the page for all.
                kind = type(error).__name__
                failures.say(kind, f"a step of the page failed: {kind}: {error}", time.monotonic(), error)
                stop.wait(1.0)


def open_browser(address: str) -> None:
    """Open the page where there is a desktop."""
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)


@contextmanager
def open_server(settings: DashboardSettings) -> Iterator[viser.ViserServer]:
    """The server of the page. Raises OSError where it cannot be served at the address of the settings."""
    logging.getLogger("websockets").setLevel(logging.WARNING)
    port = free_port(settings)
    # Suppresses viser's own prints; the caller of the dashboard prints the address.
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=settings.host, port=port, label="spot3d", verbose=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()
