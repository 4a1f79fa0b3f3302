"""Connections that end at once when they are closed, whatever has become of the other side.

Zenoh lets a connection that it closes linger for ten seconds while the other side has not confirmed all. To a side that
is out of reach this takes all of them, and the thread that waits is one of the few that pass on everybody's messages: a
router so stands still, its own host's dataflow with it, and does not answer when the link is back. A router that ends
waits as long for who stands still on its own host, and fails: Zenoh gives up closing after ten seconds.
"""

import os
import socket
import struct
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path

_AT_ONCE = struct.pack("ii", 1, 0)
_DESCRIPTORS = Path("/proc/self/fd")


def close_at_once(all_hosts: bool = False) -> None:
    """Do so for this process's TCP connections to other hosts, as they are now; elsewhere than on Linux nothing.

    all_hosts: for those within this host as well, as at the end of a router; what has not reached them is lost.
    """
    if not _DESCRIPTORS.is_dir():
        return
    for path in list(_DESCRIPTORS.iterdir()):
        # Descriptors come and go meanwhile.
        with suppress(OSError):
            if path.is_socket():
                with socket.socket(fileno=os.dup(int(path.name))) as connection:
                    _close_at_once(connection, all_hosts)


def _close_at_once(connection: socket.socket, all_hosts: bool) -> None:
    by_tcp = connection.family in (socket.AF_INET, socket.AF_INET6) and connection.type == socket.SOCK_STREAM
    if by_tcp and (all_hosts or not ip_address(connection.getpeername()[0].partition("%")[0]).is_loopback):
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
