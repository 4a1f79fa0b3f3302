"""Whether the other side can be reached again, known a tenth of a second after it can."""

import socket
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache
from selectors import EVENT_WRITE, DefaultSelector

_ASKED_EVERY_S = 0.1
"""TCP itself asks again after one second, three, seven: it may notice late by as much."""
_BY_TCP = ("tcp", "tls", "ws")


def reachable(endpoints: Sequence[str], within_s: float) -> bool:
    """Whether one of the endpoints (tcp/HOST:PORT) takes a connection within a time, seconds; asks again and again.

    Those that do not go by TCP cannot be asked, and count as reachable. Raises OSError where a name is not known.
    """
    if not all(endpoint.partition("/")[0] in _BY_TCP for endpoint in endpoints):
        return True
    end_s = time.monotonic() + within_s
    with ExitStack() as stack:
        selector = stack.enter_context(DefaultSelector())
        while (left_s := end_s - time.monotonic()) > 0:
            for endpoint in endpoints:
                family, address = _address(endpoint)
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
    return False


@cache
def _address(endpoint: str) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Looked up once: names may be known on the other side only."""
    host, _, port = endpoint.partition("/")[2].partition("#")[0].partition("?")[0].rpartition(":")
    family, _, _, _, address = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)[0]
    return family, (str(address[0]), int(address[1]))
