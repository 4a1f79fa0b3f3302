"""Finds a port for the page before viser is started, which waits for ever where it cannot listen."""

import asyncio
import errno
import os

from spot3d.dashboard.settings import DashboardSettings

_USUAL = range(8080, 9080)
"""Ports tried in turn where none was asked for: as many as by viser."""
_NOT_OURS = (errno.EADDRINUSE, errno.EACCES)
"""The port is in use, or only root may listen there."""


def free_port(settings: DashboardSettings) -> int:
    """The port of the settings, or where they have none the first of the usual ones that is free; 0, for any, stays 0.

    Raises OSError where no page can be served at that host, or at none of the ports.
    """
    return asyncio.run(_free_port(settings.host, settings.port))


async def _free_port(host: str, asked_for: int | None) -> int:
    for port in _USUAL if asked_for is None else (asked_for,):
        try:
            server = await asyncio.get_running_loop().create_server(asyncio.Protocol, host, port)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or str(error)
            if error.errno not in _NOT_OURS:
                raise OSError(_refusal(host, reason)) from error
            if asked_for is not None:
                advice = "set dashboard.port to another one, or leave it unset for the next free one"
                raise OSError(f"cannot serve the page at {host}, port {port}: {reason}; {advice}") from error
        except UnicodeError as error:
            raise OSError(_refusal(host, "it is not a valid host name")) from error
        else:
            server.close()
            return port
    first, last = _USUAL[0], _USUAL[-1]
    raise OSError(f"cannot serve the page at {host}: no port from {first} to {last} is free; set dashboard.port")


def _refusal(host: str, reason: str) -> str:
    return f"cannot serve the page at {host}: {reason}; set dashboard.host to an address of this device"
