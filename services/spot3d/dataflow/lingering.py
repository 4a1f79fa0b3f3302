"""Makes connections close at once, whatever has become of the other side.

Zenoh lets a connection that it closes linger for ten seconds while the other side has not acknowledged everything. With
an unreachable side this takes all ten. The thread that waits is one of the few that forward everybody's messages, so
the router stalls, with its own host's dataflow, and does not answer when the link is back. A router that ends waits
just as long for a stalled process on its own host, and fails: Zenoh gives up closing after ten seconds.
"""

import os
import socket
import struct
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path

_AT_ONCE = struct.pack("ii", 1, 0)
_DESCRIPTORS = Path("/proc/self/fd")


def disable_linger(all_hosts: bool = False) -> None:
    """Set this process's present TCP connections to other hosts to close without lingering; only on Linux.

    all_hosts: those within this host as well, as at the end of a router; data that has not arrived is lost.
    """
    if not _DESCRIPTORS.is_dir():
        return
    for path in list(_DESCRIPTORS.iterdir()):
        # Descriptors may close meanwhile.
        with suppress(OSError):
            if path.is_socket():
                with socket.socket(fileno=os.dup(int(path.name))) as connection:
                    _close_at_once(connection, all_hosts)


def _close_at_once(connection: socket.socket, all_hosts: bool) -> None:
    by_tcp = connection.family in (socket.AF_INET, socket.AF_INET6) and connection.type == socket.SOCK_STREAM
    if by_tcp and (all_hosts or not ip_address(connection.getpeername()[0].partition("%")[0]).is_loopback):
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
