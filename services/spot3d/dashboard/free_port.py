"""Finds a port for the page before viser is started, which waits for ever where it cannot listen."""

import asyncio
import errno
import os

from spot3d.dashboard.settings import DashboardSettings

_TRIED = 1000
"""Number of ports tried, as many as by viser."""
_PORT_MAX = 65535
_NOT_OURS = (errno.EADDRINUSE, errno.EACCES)
"""The port is in use, or only root may listen there."""


def free_port(settings: DashboardSettings) -> int:
    """The port of the settings, or the next free one; 0, for any port, stays 0.

    Raises OSError where no page can be served at that host, or none of the ports is free.
    """
    return asyncio.run(_free_port(settings.host, settings.port))


async def _free_port(host: str, first: int) -> int:
    last = min(first + _TRIED - 1, _PORT_MAX)
    for port in range(first, last + 1):
        try:
            server = await asyncio.get_running_loop().create_server(asyncio.Protocol, host, port)
        except OSError as error:
            if error.errno not in _NOT_OURS:
                reason = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or str(error)
                raise OSError(_refusal(host, reason)) from error
        except UnicodeError as error:
            raise OSError(_refusal(host, "that is no name of a host")) from error
        else:
            server.close()
            return port
    raise OSError(f"cannot serve the page at {host}: no port from {first} to {last} is free (dashboard.port)")


def _refusal(host: str, reason: str) -> str:
    return f"cannot serve the page at {host}: {reason}; is that an address of this device? (dashboard.host)"
