"""Opens Zenoh sessions as the link settings say."""

import json
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import inf

import zenoh

from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d.dataflow.tls import own_certificate, uses_tls, why_unreached
from spot3d_schemas.limits import MAX_MESSAGE_BYTES

log = logging.getLogger(__name__)

_CONNECT_MS = 1000
"""Time for one attempt to reach the router; between attempts a stop request is noticed."""
_LEASE_MS = 2000
"""A peer that is silent for this long counts as gone."""
_RECEIVED_BYTES = MAX_MESSAGE_BYTES + 128 * 2**10
"""Zenoh drops longer messages while they arrive. The longest of the contract's and its key, encoding and number fit."""
_LARGE_BYTES = 65536
"""Messages of at least this size go through shared memory between processes on one host."""
_NOT_OURS = "check that it is an address of this device"
_REMEDIES = {
    "in use": "the port or socket may be in use: end the program that listens there, or choose another",
    "assign requested address": _NOT_OURS,
    "failed to lookup address": _NOT_OURS,
}
"""What helps against the errors of listening, by a part of their text."""


def zenoh_config(link: LinkSettings) -> zenoh.Config:
    """Zenoh's configuration of a link. Raises zenoh.ZError where an endpoint is not understood."""
    config = zenoh.Config()
    values: dict[str, object] = {
        "mode": link.mode,
        "connect/endpoints": link.connect,
        "listen/endpoints": link.listen,
        # Routers and peers may start alone; a client needs its router.
        "connect/exit_on_failure": link.mode == "client",
        "connect/timeout_ms": _CONNECT_MS,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        # Time that routers and peers wait for multicast discovery.
        "scouting/delay": 0,
        # Zenoh's own timestamps are not read. With them, it logs every message stamped by a clock that is ahead of its
        # own.
        "timestamping/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/rx/max_message_size": _RECEIVED_BYTES,
        "transport/shared_memory/enabled": link.shared_memory and link.delivery == "live",
        # Images only: small messages gain nothing, and a reply to a query cannot be repeated as a frame can.
        "transport/shared_memory/transport_optimization/message_size_threshold": _LARGE_BYTES,
        "transport/shared_memory/transport_optimization/messages": ["put"],
    }
    if any(map(uses_tls, (*link.connect, *link.listen))):
        values["transport/link/tls"] = _tls(link)
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _tls(link: LinkSettings) -> dict[str, object]:
    """A listener, which has a certificate, asks for that of each client: TLS is mutual."""
    certificate, key = (None if file is None else str(file) for file in (link.certificate, link.key))
    return {
        "root_ca_certificate": None if link.ca is None else str(link.ca),
        "enable_mtls": certificate is not None,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
        "verify_name_on_connect": link.verify_names,
        "close_link_on_expiration": True,
    }


@contextmanager
def open_session(
    link: LinkSettings,
    stop: threading.Event | None = None,
    more: Mapping[str, object] | None = None,
    patience_s: float = inf,
) -> Iterator[zenoh.Session]:
    """A session that is closed in the end. A client waits for its router, and logs that it does.

    more: other values of Zenoh's configuration, by key, for a router. patience_s: longest wait for the router. Raises
    StoppedError if that is over or `stop` is set while waiting, TlsError if the link's own certificate cannot be used,
    ConnectionError if a router or peer cannot open.
    """
    # With this a router logs whom it refuses.
    zenoh.init_log_from_env_or("error,zenoh_link_tls=warn")
    own = own_certificate(link)
    if own is not None and own.soon_over:
        log.warning(
            "this side's certificate %s is for %s and expires soon: make a new one (spot3d certificates --out FOLDER "
            "NAME --renew)",
            link.certificate,
            own,
        )
    # A session that is left open keeps the interpreter from ending.
    with _open(link, stop or threading.Event(), more, time.monotonic() + patience_s) as session:
        yield session


def _open(
    link: LinkSettings, stop: threading.Event, more: Mapping[str, object] | None, deadline_s: float
) -> zenoh.Session:
    config = zenoh_config(link)
    for key, value in (more or {}).items():
        config.insert_json5(key, json.dumps(value))
    tries = 0
    while not stop.is_set() and time.monotonic() < deadline_s:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if link.mode != "client":
                where, reason = ", ".join(link.listen or link.connect), first_line(error)
                remedies = [remedy for part, remedy in _REMEDIES.items() if part in reason]
                raise ConnectionError("; ".join((f"cannot listen at {where}: {reason}", *remedies))) from error
            if tries % 10 == 0:
                reason, remedy = why_unreached(link, "start one there (spot3d router)")
                where = ", ".join(link.connect)
                log.warning("no router at %s yet, retrying: %s; %s", where, reason or first_line(error), remedy)
            tries += 1
            stop.wait(0.1)
    raise StoppedError


def first_line(error: Exception) -> str:
    """Zenoh's error text without its place in Zenoh's source; `no answer` where it names only the endpoint."""
    said = str(error).partition("\n")[0].partition(" at /")[0].strip()
    return "no answer" if said.startswith("Unable to connect to any of") else said
