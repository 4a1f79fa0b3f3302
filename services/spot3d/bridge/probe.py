"""Detects within a tenth of a second that the other side can be reached again."""

import socket
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from selectors import EVENT_WRITE, DefaultSelector

from spot3d.dataflow.settings import host_and_port

_ASKED_EVERY_S = 0.1
"""Time between attempts. TCP itself tries again after one second, three, seven: it may notice late by as much."""
_BY_TCP = ("tcp", "tls", "ws")
_Address = tuple[socket.AddressFamily, tuple[str, int]]
_known: dict[str, list[_Address]] = {}
"""Addresses by endpoint; endpoints that were not reached by them; endpoints whose names are being looked up again."""
_outdated: set[str] = set()
_looked_up: set[str] = set()


def reachable(endpoints: Sequence[str], within_s: float) -> bool:
    """Whether one of the endpoints (tcp/HOST:PORT) accepts a connection within a time, seconds; tries again and again.

    Each address of an endpoint's name is tried. Endpoints that do not use TCP cannot be tried, and count as reachable.
    Raises OSError where a name is not known.
    """
    if not all(endpoint.partition("/")[0] in _BY_TCP for endpoint in endpoints):
        return True
    end_s = time.monotonic() + within_s
    with ExitStack() as stack:
        selector = stack.enter_context(DefaultSelector())
        while (left_s := end_s - time.monotonic()) > 0:
            for family, address in (known for endpoint in endpoints for known in _addresses(endpoint)):
                asking = stack.enter_context(socket.socket(family, socket.SOCK_STREAM))
                asking.setblocking(False)
                asking.connect_ex(address)
                selector.register(asking, EVENT_WRITE)
            asked_s = time.monotonic()
            for key, _ in selector.select(min(left_s, _ASKED_EVERY_S)):
                if isinstance(key.fileobj, socket.socket):
                    if key.fileobj.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0:
                        return True
                    selector.unregister(key.fileobj)
            time.sleep(max(0.0, min(end_s, asked_s + _ASKED_EVERY_S) - time.monotonic()))
    _outdated.update(endpoints)
    return False


def _addresses(endpoint: str) -> list[_Address]:
    """The known addresses of an endpoint's name.

    If none of them was reached, the name may have others by now. It is looked up again, without waiting for that, since
    it may be known on the other side only.
    """
    if endpoint not in _known:
        _look_up(endpoint)
    elif endpoint in _outdated and endpoint not in _looked_up:
        _outdated.discard(endpoint)
        _looked_up.add(endpoint)
        threading.Thread(target=_look_up_again, args=(endpoint,), name="look up", daemon=True).start()
    return _known[endpoint]


def _look_up(endpoint: str) -> None:
    found = socket.getaddrinfo(*host_and_port(endpoint), type=socket.SOCK_STREAM)
    _known[endpoint] = [(family, (str(to[0]), int(to[1]))) for family, _, _, _, to in found]


def _look_up_again(endpoint: str) -> None:
    with suppress(OSError):
        _look_up(endpoint)
    _looked_up.discard(endpoint)
