"""Explains why a TLS link cannot be established; Zenoh itself only times out."""

import datetime
import socket
import ssl
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from spot3d.dataflow.settings import LinkSettings, host_and_port
from spot3d.file_errors import why

EXPIRES_SOON = datetime.timedelta(days=14)
_PROBE_S = 1.0
"""Longest wait for a router to begin TLS."""
_REFUSAL_S = 0.3
"""Wait for a refusal: a server rejects a client's certificate right after the handshake, or not at all."""
_PROTOCOLS = ("tls", "quic")
_CERTIFICATES = "check [link] ca, certificate and key (docs/security.md)"


class TlsError(OSError):
    """A certificate, key or authority that cannot be used; the message says which and why."""


class TlsRefusedError(TlsError):
    """A router is there, but it and this side do not agree on TLS; the message says why."""


@dataclass(frozen=True, slots=True)
class Validity:
    """A certificate's common name, and until when it is valid."""

    name: str
    until: datetime.datetime

    def __str__(self) -> str:
        return f"{self.name}, valid until {self.until:%Y-%m-%d %H:%M} UTC"

    @property
    def soon_over(self) -> bool:
        """Whether it expires within two weeks."""
        return self.until - datetime.datetime.now(datetime.UTC) < EXPIRES_SOON


def uses_tls(endpoint: str) -> bool:
    """Whether an endpoint such as tls/10.0.0.2:7447 is encrypted."""
    return endpoint.partition("/")[0] in _PROTOCOLS


def own_certificate(link: LinkSettings) -> Validity | None:
    """The validity of the link's own certificate, verified as another side would; None if it has none.

    Raises TlsError if a file cannot be read, key and certificate do not match, or the authority would not accept the
    certificate today (it has expired, say).
    """
    if link.certificate is None or link.key is None:
        return None
    ours = _context(ssl.PROTOCOL_TLS_SERVER, link)
    other = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    other.check_hostname = False
    _load_authorities(other, link.ca)
    try:
        return _validity(_talk(ours, other))
    except ssl.SSLCertVerificationError as error:
        raise TlsError(
            f"the certificate {link.certificate} is not accepted by {link.ca or 'public authorities'}: "
            f"{error.verify_message}; make a new one with spot3d certificates, and check this device's clock"
        ) from error


def probe(endpoint: str, link: LinkSettings) -> Validity:
    """Begin TLS with the router at `endpoint` as this link would; returns the validity of its certificate.

    Raises TlsRefusedError with the reason in words if either side refuses the other, or the router begins no TLS, and
    TlsError if nobody answers.
    """
    host, port = host_and_port(endpoint)
    context = _context(ssl.PROTOCOL_TLS_CLIENT, link)
    context.check_hostname = link.verify_names
    try:
        with _connected(host, port) as plain, _begun(context, plain, endpoint) as secured:
            validity = _validity(secured.getpeercert())
            secured.settimeout(_REFUSAL_S)
            with suppress(TimeoutError):  # the router waits for data: it accepts us
                secured.recv(1)
            return validity
    except ssl.SSLCertVerificationError as error:
        raise TlsRefusedError(f"{endpoint}: the router's certificate is refused: {error.verify_message}") from error
    except ssl.SSLError as error:
        raise TlsRefusedError(f"{endpoint}: the router refuses this side: {_words(error)}") from error
    except TlsError:
        raise
    except OSError as error:
        raise TlsError(f"{endpoint}: {error.strerror or error}") from error


def why_refused(link: LinkSettings) -> str:
    """Why the endpoints that a link connects to cannot be used, as far as TLS is the reason; else empty."""
    return "; ".join(map(str, _refusals(link)))


def why_unreached(link: LinkSettings, start: str) -> tuple[str, str]:
    """Why no router lets a link in, as `why_refused` says it, and what to do; start: that where none answers."""
    refusals = _refusals(link)
    if any(isinstance(error, TlsRefusedError) for error in refusals):
        remedy = _CERTIFICATES
    elif any(endpoint.startswith("quic/") for endpoint in link.connect):
        remedy = f"{start}; if a router is there, it may refuse this side, which quic does not tell: {_CERTIFICATES}"
    else:
        remedy = start
    return "; ".join(map(str, refusals)), remedy


def _refusals(link: LinkSettings) -> list[TlsError]:
    """What is wrong with the tls endpoints that a link connects to, and the tcp endpoints at which TLS is spoken."""
    refusals = list[TlsError]()
    for endpoint in link.connect:
        try:
            if endpoint.startswith("tls/"):
                probe(endpoint, link)
            elif endpoint.startswith("tcp/") and _speaks_tls(endpoint):
                instead = f"tls/{endpoint.partition('/')[2]}"
                raise TlsRefusedError(f"{endpoint}: the router expects TLS; write {instead}")
        except TlsError as error:
            refusals.append(error)
    return refusals


def _speaks_tls(endpoint: str) -> bool:
    """Whether a router at a tcp endpoint expects TLS."""
    host, port = host_and_port(endpoint)
    anybody = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    anybody.check_hostname, anybody.verify_mode = False, ssl.CERT_NONE
    with suppress(OSError), _connected(host, port) as plain, anybody.wrap_socket(plain, server_hostname=host):
        return True
    return False


def _connected(host: str, port: int) -> socket.socket:
    return socket.create_connection((host, port), timeout=_PROBE_S)


def _begun(context: ssl.SSLContext, plain: socket.socket, endpoint: str) -> ssl.SSLSocket:
    try:
        return context.wrap_socket(plain, server_hostname=host_and_port(endpoint)[0])
    except TimeoutError as error:
        instead = f"tcp/{endpoint.partition('/')[2]}"
        raise TlsRefusedError(f"{endpoint}: the router does not begin TLS; if it uses none, write {instead}") from error


def _context(protocol: int, link: LinkSettings) -> ssl.SSLContext:
    context = ssl.SSLContext(protocol)
    _load_authorities(context, link.ca)
    if link.certificate is not None and link.key is not None:
        for file in (link.certificate, link.key):
            _refuse_unreadable(file)
        try:
            context.load_cert_chain(link.certificate, link.key, partial(_refuse_password, link.key))
        except ssl.SSLError as error:
            if error.reason == "KEY_VALUES_MISMATCH":
                raise TlsError(f"{link.key} is not the key of the certificate {link.certificate}") from error
            raise TlsError(
                f"{link.certificate} and {link.key} are not a valid certificate and key: {_words(error)}"
            ) from error
    return context


def _load_authorities(context: ssl.SSLContext, file: Path | None) -> None:
    """Trust the authority in a file; None: the public ones."""
    if file is None:
        context.load_default_certs()
        return
    _refuse_unreadable(file)
    try:
        context.load_verify_locations(file)
    except ssl.SSLError as error:
        raise TlsError(f"{file} is not a valid CA certificate: {_words(error)}") from error


def _refuse_password(key: Path) -> str:
    """Called for an encrypted key, whose password OpenSSL would ask for on the terminal, and Zenoh cannot use."""
    raise TlsError(f"{key} has a password; give a key without one")


def _refuse_unreadable(file: Path) -> None:
    try:
        file.open("rb").close()
    except OSError as error:
        raise TlsError(f"cannot read {file}: {why(error)}") from error


def _talk(ours: ssl.SSLContext, other: ssl.SSLContext) -> Mapping[str, object] | None:
    """A TLS handshake in memory; returns our certificate as the other side has read it."""
    to_us, to_other = ssl.MemoryBIO(), ssl.MemoryBIO()
    server = ours.wrap_bio(to_us, to_other, server_side=True)
    client = other.wrap_bio(to_other, to_us)
    for _ in range(4):
        for side in (client, server):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
    return client.getpeercert()


def _validity(certificate: Mapping[str, object] | None) -> Validity:
    fields = certificate or {}
    subject = fields.get("subject")
    parts = subject if isinstance(subject, tuple) else ()
    named = next((value for part in parts for name, value in part if name == "commonName"), "unnamed")
    ends_s = ssl.cert_time_to_seconds(str(fields["notAfter"]))
    return Validity(named, datetime.datetime.fromtimestamp(ends_s, datetime.UTC))


def _words(error: ssl.SSLError) -> str:
    """OpenSSL's reason without its number; an alert is the other side's reason."""
    return (error.reason or str(error)).lower().replace("_", " ")
