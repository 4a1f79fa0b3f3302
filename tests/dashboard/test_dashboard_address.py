"""Where the page is served, and what is said where it cannot be."""

import socket
import sys
from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="the dashboard's packages are not installed")

from spot3d.cli import app as cli
from spot3d.dashboard import free_port as free_port_module
from spot3d.dashboard.free_port import free_port
from spot3d.dashboard.process import open_server
from spot3d.dashboard.settings import DashboardSettings

FOREIGN = "192.0.2.1"
"""An address of documentation (RFC 5737), which no device has."""


@pytest.mark.parametrize("command", [["dashboard", "--no-browser"], ["run", "scene", "--frames", "1", "--dashboard"]])
def test_an_address_that_is_not_ours_is_refused_in_one_line(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPOT3D_DASHBOARD__HOST", FOREIGN)
    monkeypatch.setattr(sys, "argv", ["spot3d", *command])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        f"error: cannot serve the page at {FOREIGN}: Cannot assign requested address; "
        "set dashboard.host to an address of this device\n"
    )
    assert not list(tmp_path.iterdir()), "the run has not begun"


def test_what_is_no_name_of_a_host_is_refused() -> None:
    with pytest.raises(OSError, match=r"at a\.\.b: it is not a valid host name; set dashboard.host to an address"):
        free_port(DashboardSettings(host="a..b"))


def test_the_usual_port_gives_way_to_the_next_free_one_where_it_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr(free_port_module, "_USUAL", range(port, port + 100))
        with open_server(DashboardSettings()) as server:
            assert port < server.get_port() < port + 100


def test_where_no_usual_port_is_free_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr(free_port_module, "_USUAL", range(port, port + 1))
        with pytest.raises(OSError, match=rf"at 127\.0\.0\.1: no port from {port} to {port} is free"):
            free_port(DashboardSettings())


def test_a_port_that_was_asked_for_and_is_taken_is_refused() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match="cannot serve") as refused:
            free_port(DashboardSettings(port=port))
    assert str(refused.value) == (
        f"cannot serve the page at 127.0.0.1, port {port}: Address already in use; "
        "set dashboard.port to another one, or leave it unset for the next free one"
    )


def test_any_port_will_do() -> None:
    with open_server(DashboardSettings(port=0)) as server:
        assert server.get_port() > 0
