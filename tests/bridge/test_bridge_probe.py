"""Whether the other side is there: all addresses of its name are asked, and looked up again where none was reached."""

import socket

import pytest

from spot3d.bridge import probe


@pytest.fixture
def listener() -> socket.socket:
    with socket.create_server(("127.0.0.1", 0)) as opened:
        yield opened


def named(monkeypatch: pytest.MonkeyPatch, *hosts: str) -> None:
    """From now on a name has these addresses; none: it is not known."""

    def look_up(_host: str, port: int, **_: object) -> list[tuple[object, ...]]:
        if not hosts:
            raise socket.gaierror("not known")
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (host, port)) for host in hosts]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)


def endpoint_of(listener: socket.socket, name: str) -> str:
    return f"tcp/{name}:{listener.getsockname()[1]}"


def test_every_address_of_a_name_is_asked(listener: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    named(monkeypatch, "127.0.0.2", "127.0.0.1")
    assert probe.reachable([endpoint_of(listener, "two")], 5.0)


def test_a_name_may_get_another_address(listener: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    where = [endpoint_of(listener, "moves")]
    named(monkeypatch, "127.0.0.2")
    assert not probe.reachable(where, 0.2)
    named(monkeypatch, "127.0.0.1")
    assert probe.reachable(where, 5.0)
    named(monkeypatch)
    assert probe.reachable(where, 5.0), "a name that only the other side knows has the address that it had"


def test_a_name_that_nobody_knows_is_told(listener: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    named(monkeypatch)
    with pytest.raises(socket.gaierror):
        probe.reachable([endpoint_of(listener, "nowhere")], 0.1)
