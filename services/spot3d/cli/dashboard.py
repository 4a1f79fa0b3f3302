"""`spot3d dashboard`: what robots see and find, in the browser."""

import sys
from contextlib import AbstractContextManager, closing, nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spot3d.cli import options
from spot3d.cli.options import CommandError, link_overrides, stage_started
from spot3d.settings import Settings, load_settings

if TYPE_CHECKING:
    from rich.console import Console

    from spot3d.run.dashboard_process import DashboardProcess


HostOption = Annotated[str | None, typer.Option(help="address to serve the page on; default: 127.0.0.1")]
PortOption = Annotated[int | None, typer.Option(help="port to serve the page on; default: 8080, or the next free port")]


def dashboard(
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    listen: options.Listen = None,
    host: HostOption = None,
    port: PortOption = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="do not open a browser")] = False,
    supervised: options.Supervised = False,
) -> None:
    """A page in the browser that shows what robots see and find, live."""
    page: dict[str, Any] = {name: value for name, value in (("host", host), ("port", port)) if value is not None}
    resolved = load_settings(settings, None, link_overrides(robot, connect, listen) | {"dashboard": page})
    stop = stage_started(supervised)
    from spot3d.dashboard.process import open_browser, run

    def tell(address: str) -> None:
        typer.echo(f"dashboard: {address}")
        if not no_browser:
            open_browser(address)

    run(resolved.link, resolved.dashboard, stop, robot, always=supervised, on_ready=tell)


def dashboard_if_wanted(
    wanted: bool, in_process: bool, resolved: Settings, file: Path | None, out: Path, console: "Console"
) -> "AbstractContextManager[DashboardProcess | None]":
    """The dashboard of a run, if it is wanted, to be started. file: the run's settings; out: folder of its results.

    Raises OSError if its page cannot be served: its own process would only log that.
    """
    if not wanted:
        return nullcontext()
    if in_process:
        raise CommandError("--in-process publishes no messages for the dashboard; omit --in-process or --dashboard")
    if find_spec("viser") is None:
        raise CommandError("the dashboard needs viser: pip install 'spot3d[dashboard]'")
    from spot3d.dashboard.free_port import free_port
    from spot3d.run.dashboard_process import DashboardProcess

    free_port(resolved.dashboard)
    return closing(DashboardProcess(resolved.link.robot, file, out / "dashboard.log", console))


def own_command() -> str:
    """How to call this program in the shell, short enough to be typed."""
    path = Path(sys.executable).with_name("spot3d")
    if not path.exists():
        return "spot3d"
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)
