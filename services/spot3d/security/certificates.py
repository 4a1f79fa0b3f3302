"""A private certificate authority, and the certificates that it signs, one for each role."""

import datetime
import ipaddress
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from spot3d_schemas import checked_name

T = TypeVar("T")

CA = "ca"
"""Name of the authority's files."""
_CA_DAYS = 3650
_BACKDATED = datetime.timedelta(hours=1)
"""Devices' clocks are not always right."""


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate and its private key, as files."""

    name: str
    certificate: Path
    key: Path
    valid_until: datetime.datetime


@dataclass(frozen=True, slots=True)
class Authority:
    """A certificate authority: its certificate and key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def open_authority(folder: Path, now: datetime.datetime) -> Authority:
    """The authority whose `ca.pem` and `ca.key` are in `folder`; made where there is none.

    Raises ValueError where only one of them is there, one is not valid, or they do not belong together.
    """
    certificate, key = folder / f"{CA}.pem", folder / f"{CA}.key"
    if certificate.exists() != key.exists():
        raise ValueError(f"{folder} contains only one of {CA}.pem and {CA}.key: add the other, or use an empty folder")
    if not certificate.exists():
        return _make_authority(folder, now)
    private = _read(key, "private key without a password", lambda data: load_pem_private_key(data, None))
    if not isinstance(private, ec.EllipticCurvePrivateKey):
        raise ValueError(f"{key} is not an elliptic-curve key, so it was not made by spot3d certificates")
    authority = Authority(_read(certificate, "certificate", x509.load_pem_x509_certificate), private)
    if authority.certificate.public_key() != private.public_key():
        raise ValueError(f"{key} is not the key of {certificate}: restore the original, or use an empty folder")
    return authority


def _read(file: Path, kind: str, load: Callable[[bytes], T]) -> T:
    """The content of a PEM file. Raises ValueError, naming the file, if it is not of this kind."""
    try:
        return load(file.read_bytes())
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        remedy = "restore the original, or use an empty folder"
        raise ValueError(f"{file} is not a {kind} in PEM: {remedy}") from error


def issue(
    authority: Authority,
    folder: Path,
    name: str,
    hosts: Sequence[str] = (),
    *,
    begins: datetime.datetime,
    ends: datetime.datetime,
) -> Issued:
    """Write `NAME.pem` and `NAME.key` (readable by its owner alone) for the common name `name`.

    hosts: host names and addresses at which others connect, and which they verify; `name` is always one of them.
    Raises ValueError where the name cannot be part of a key, or `ends` is after the authority's own end.
    """
    last = authority.certificate.not_valid_after_utc
    if ends > last:
        raise ValueError(
            f"{name} would be valid until {ends:%Y-%m-%d}, but the authority is valid only until {last:%Y-%m-%d}; "
            "give fewer days"
        )
    key = ec.generate_private_key(ec.SECP256R1())
    usages = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    certificate = (
        _builder(_named(checked_name(name)), authority.certificate.subject, key.public_key(), begins, ends)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .add_extension(x509.SubjectAlternativeName([_host(host) for host in (name, *hosts)]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key()), critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    return _write(folder, name, certificate, key)


def issue_all(
    folder: Path, names: Sequence[str], hosts: Mapping[str, Sequence[str]], days: int, *, renew: bool = False
) -> list[Issued]:
    """Certificates for all `names`, valid for `days` from now; the authority is made where there is none.

    hosts: addresses and host names of each name; a certificate that is renewed without any keeps those it had.
    Raises ValueError where a certificate of a name exists and is not to be renewed, where a new authority would be
    valid for fewer days, and as `issue` does.
    """
    unknown = sorted(set(hosts) - set(names))
    if unknown:
        raise ValueError(f"hosts are given for {', '.join(unknown)}, but no certificate is requested for them")
    if CA in names:
        raise ValueError(f"{CA} is the name of the authority itself; choose another name")
    if days > _CA_DAYS:
        raise ValueError(
            f"the certificates would be valid for {days} days, but the authority is valid only until {_CA_DAYS} days "
            "after it is made; give fewer days"
        )
    there = [name for name in names if (folder / f"{name}.pem").exists()]
    if there and not renew:
        raise ValueError(f"{folder} already contains certificates of {', '.join(there)}; --renew replaces them")
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)  # certificates state whole seconds
    folder.mkdir(parents=True, exist_ok=True)
    authority = open_authority(folder, now)
    begins, ends = now - _BACKDATED, now + datetime.timedelta(days=days)
    kept = {name: _hosts_of(folder / f"{name}.pem") for name in there if name not in hosts}
    hosts = {**kept, **hosts}
    return [issue(authority, folder, name, hosts.get(name, ()), begins=begins, ends=ends) for name in names]


def _hosts_of(file: Path) -> list[str]:
    """The addresses and host names of a certificate, without its own name. Raises ValueError if it is none."""
    try:
        stated = x509.load_pem_x509_certificate(file.read_bytes()).extensions
    except ValueError as error:
        raise ValueError(f"{file} is not a valid certificate: delete it, and make a new one") from error
    hosts = stated.get_extension_for_class(x509.SubjectAlternativeName).value
    return [str(host.value) for host in hosts if host.value != file.stem]


def _make_authority(folder: Path, now: datetime.datetime) -> Authority:
    key = ec.generate_private_key(ec.SECP256R1())
    # A unique name: of two authorities of one name, a wrong one would be reported as a broken signature.
    name = _named(f"spot3d private authority {secrets.token_hex(4)}")
    ends = now + datetime.timedelta(days=_CA_DAYS)
    signs = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    certificate = (
        _builder(name, name, key.public_key(), now - _BACKDATED, ends)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(signs, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    _write(folder, CA, certificate, key)
    return Authority(certificate, key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    begins: datetime.datetime,
    ends: datetime.datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(begins)
        .not_valid_after(ends)
    )


def _named(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> Issued:
    issued = Issued(name, folder / f"{name}.pem", folder / f"{name}.key", certificate.not_valid_after_utc)
    issued.certificate.write_bytes(certificate.public_bytes(Encoding.PEM))
    issued.key.unlink(missing_ok=True)
    # Readable for nobody else from the beginning.
    with os.fdopen(os.open(issued.key, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
        stream.write(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    return issued
