"""The dashboard's process: serves the page until it is stopped."""

import contextlib
import io
import logging
import os
import sys
import threading
import webbrowser
from collections.abc import Callable

import viser

from spot3d.dashboard.link import Link
from spot3d.dashboard.page import Page
from spot3d.dashboard.settings import DashboardSettings
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

    robot: the one to show first. always: follow the map even while no browser looks. on_ready: is told the address.
    Raises OSError where the page cannot be served at the address of the settings.
    """
    logging.getLogger("websockets").setLevel(logging.WARNING)
    with stop_on_signals(stop) as stopped:
        server = _server(settings)
        try:
            where = ", ".join(link.listen or link.connect)
            with Link(link, settings.map_rate) as heard:
                page = Page(server, heard, settings, where, always)
                on_ready(f"http://{'127.0.0.1' if settings.host == '0.0.0.0' else settings.host}:{server.get_port()}")
                while not stopped.wait(_STEP_S):
                    try:
                        page.step(robot)
                    except Exception:
                        # What one robot sends, or one browser does, must not end the page for all.
                        log.exception("a step of the page failed")
                        stopped.wait(1.0)
        finally:
            server.stop()


def open_browser(address: str) -> None:
    """Open the page where there is a desktop."""
    if sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)


def _server(settings: DashboardSettings) -> viser.ViserServer:
    # viser prints a box with its addresses; ours is told by whoever starts the dashboard.
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=settings.host, port=settings.port, label="spot3d", verbose=False)
