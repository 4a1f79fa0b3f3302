"""`spot3d certificates`: a private authority in a folder, and what is refused."""

import stat
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat
from typer.testing import CliRunner

from spot3d.cli.app import app
from spot3d.cli.options import CommandError
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.tls import own_certificate


def ask(folder: Path, *arguments: str) -> str:
    outcome = CliRunner().invoke(app, ["certificates", "--out", str(folder), *arguments])
    if outcome.exception is not None:
        raise outcome.exception
    return outcome.output


def certificate(folder: Path, name: str) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())


def test_a_certificate_for_each_role_of_one_authority(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "certificates"
    said = ask(folder, "drone", "ground", "--host", "ground=10.0.0.2", "--host", "ground=base", "--days", "30")
    assert "ground.pem and ground.key: ground, valid until 20" in said
    said = ask(folder, "dashboard")
    assert {path.name for path in folder.iterdir()} == {
        f"{name}.{kind}" for name in ("ca", "drone", "ground", "dashboard") for kind in ("pem", "key")
    }
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.glob("*.key")} == {0o600}
    names = certificate(folder, "ground").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["ground", "base"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["10.0.0.2"]
    ask(folder, "drone", "ground", "--host", "drone=10.0.0.3", "--renew")
    kept = certificate(folder, "ground").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert kept == names, "addresses that nobody states anew"
    for name in ("drone", "ground", "dashboard"):
        files = {"certificate": folder / f"{name}.pem", "key": folder / f"{name}.key"}
        own = own_certificate(LinkSettings(ca=folder / "ca.pem", **files))
        assert own is not None
        assert own.name == name
        assert own.soon_over is False


def test_what_is_there_is_replaced_only_if_asked(tmp_path: Path) -> None:
    ask(tmp_path, "drone")
    before = certificate(tmp_path, "drone"), certificate(tmp_path, "ca")
    with pytest.raises(CommandError, match=r"already contains certificates of drone; --renew"):
        ask(tmp_path, "drone", "ground")
    assert not (tmp_path / "ground.pem").exists()
    ask(tmp_path, "drone", "--renew")
    assert certificate(tmp_path, "drone") != before[0]
    assert certificate(tmp_path, "ca") == before[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a/b",), "cannot be part of a key"),
        (("ca",), "the name of the authority itself"),
        (("drone", "--days", "4000"), "but the authority is valid only until"),
        (
            ("drone", "--days", "10000000"),
            "for 10000000 days, but the authority is valid only until .*; give fewer days",
        ),
        (
            ("drone", "--host", "ground=10.0.0.2"),
            "hosts are given for ground, but no certificate is requested for them",
        ),
        (("drone", "--host", "drone"), "is not NAME=ADDRESS"),
    ],
)
def test_what_makes_no_certificate_is_told(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    with pytest.raises(CommandError, match=words):
        ask(tmp_path, *arguments)


def test_certificates_are_valid_for_as_long_as_a_new_authority_and_no_longer(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="the authority is valid only until 3650 days after it is made"):
        ask(tmp_path / "too long", "drone", "--days", "3651")
    assert not (tmp_path / "too long").exists()
    ask(tmp_path, "drone", "--days", "3650")
    assert certificate(tmp_path, "drone").not_valid_after_utc == certificate(tmp_path, "ca").not_valid_after_utc


def test_half_an_authority_is_refused(tmp_path: Path) -> None:
    ask(tmp_path, "drone")
    (tmp_path / "ca.key").unlink()
    with pytest.raises(CommandError, match=r"contains only one of ca.pem and ca.key"):
        ask(tmp_path, "ground")


PASSWORD = ec.generate_private_key(ec.SECP256R1()).private_bytes(
    Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret")
)
BROKEN = b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("ca.key", b"", "private key without a password"),
        ("ca.key", b"not in PEM", "private key without a password"),
        ("ca.key", PASSWORD, "private key without a password"),
        ("ca.pem", b"", "certificate"),
        ("ca.pem", BROKEN, "certificate"),
    ],
)
def test_a_file_of_the_authority_that_is_none_is_named(tmp_path: Path, name: str, content: bytes, kind: str) -> None:
    ask(tmp_path, "drone")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CommandError) as refused:
        ask(tmp_path, "ground")
    remedy = "restore the original, or use an empty folder"
    assert str(refused.value) == f"{tmp_path / name} is not a {kind} in PEM: {remedy}"


def test_the_key_of_another_authority_is_refused(tmp_path: Path) -> None:
    """Nobody would accept its certificates."""
    own, other = tmp_path / "own", tmp_path / "other"
    for folder in (own, other):
        ask(folder, "drone")
    (own / "ca.key").write_bytes((other / "ca.key").read_bytes())
    with pytest.raises(CommandError, match=r"ca.key is not the key of .*ca.pem: restore the original"):
        ask(own, "ground")
    assert not (own / "ground.pem").exists()
