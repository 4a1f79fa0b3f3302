"""A certificate that cannot be used is told in words, on the side that has it and on the side that sees it."""

import logging
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import zenoh
from authority import link, make_fleet
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    load_pem_private_key,
)
from rich.console import Console

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session, zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d.dataflow.tls import TlsError, own_certificate, probe, why_refused, why_unreached
from spot3d.doctor.examine import reached
from spot3d.run.status import show_status


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_fleet(tmp_path_factory.mktemp("fleet"))


def test_own_certificate_says_whose_and_until_when(fleet: Path) -> None:
    own = own_certificate(link(fleet, "drone"))
    assert own is not None
    assert own.name == "drone"
    assert own.soon_over
    assert re.fullmatch(r"drone, valid until \d{4}-\d\d-\d\d \d\d:\d\d UTC", str(own))


@pytest.mark.parametrize(
    ("name", "key", "words"),
    [
        ("expired", None, r"expired.pem is not accepted by .*ca.pem: certificate has expired; .* this device's clock"),
        ("drone", "dashboard", r"dashboard.key is not the key of the certificate .*drone.pem"),
        ("nobody", None, r"cannot read .*nobody.pem: it, or the folder"),
        ("stranger/drone", None, r"drone.pem is not accepted by .*ca.pem: unable to get local issuer certificate"),
    ],
)
def test_own_certificate_that_cannot_be_used_is_refused_before_it_is_shown(
    fleet: Path, name: str, key: str | None, words: str
) -> None:
    with pytest.raises(TlsError, match=words), open_session(link(fleet, name, "tls/127.0.0.1:1", key=key)):
        pass


def test_what_is_no_certificate_is_told(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_text("no certificate")
    with pytest.raises(TlsError, match=r"ca.pem is not a valid CA certificate"):
        own_certificate(link(fleet, "drone").model_copy(update={"ca": tmp_path / "ca.pem"}))
    with pytest.raises(ValueError, match="belong together"):
        LinkSettings(certificate=fleet / "drone.pem")
    with pytest.raises(ValueError, match="needs a certificate"):
        LinkSettings(mode="router", listen=("tls/127.0.0.1:1",))


def test_a_key_with_a_password_is_refused_and_nobody_is_asked_for_it(fleet: Path, tmp_path: Path) -> None:
    """In a process of its own without a terminal: with one it would wait there for the password."""
    key = tmp_path / "drone.key"
    plain = load_pem_private_key((fleet / "drone.key").read_bytes(), None)
    key.write_bytes(plain.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret")))
    command = [sys.executable, "-m", "spot3d", "router", "--listen", free_loopback_endpoint()]
    files = {"CA": fleet / "ca.pem", "CERTIFICATE": fleet / "drone.pem", "KEY": key}
    environment = os.environ | {f"SPOT3D_LINK__{name}": str(file) for name, file in files.items()}
    ended = subprocess.run(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        start_new_session=True,
        check=False,
    )
    assert ended.returncode != 0
    assert f"{key} has a password; give a key without one" in ended.stderr


def test_a_router_tells_whom_it_refuses_and_the_refused_learns_why(fleet: Path) -> None:
    """The router as a process of its own, so that its log is what an operator reads."""
    endpoint = free_loopback_endpoint().replace("tcp/", "tls/")
    settings = fleet / "router.toml"
    settings.write_text(
        f'[link]\nca = "{fleet / "ca.pem"}"\ncertificate = "{fleet / "ground.pem"}"\nkey = "{fleet / "ground.key"}"\n'
    )
    command = [sys.executable, "-m", "spot3d", "router", "--settings", str(settings), "--listen", endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as router:
        try:
            assert router.stdout is not None
            assert "ground.pem is for ground, valid until" in router.stdout.readline()
            assert router.stdout.readline() == f"router listens at {endpoint}\n"
            assert probe(endpoint, link(fleet, "drone")).name == "ground"
            with pytest.raises(TlsError, match=r"the router refuses this side: .*certificate required"):
                probe(endpoint, link(fleet, None))
            with pytest.raises(TlsError, match=r"the router refuses this side: .*certificate expired"):
                probe(endpoint, link(fleet, "expired"))
            foreign = link(fleet, "drone").model_copy(update={"ca": fleet / "stranger" / "ca.pem"})
            with pytest.raises(TlsError, match=r"the router's certificate is refused: .*certificate"):
                probe(endpoint, foreign)
            with pytest.raises(TlsError, match=r"the router's certificate is refused: .*localhost"):
                probe(endpoint.replace("127.0.0.1", "localhost"), link(fleet, "drone"))
        finally:
            router.terminate()
        said = router.stdout.read()
    assert "certificate expired: verification time" in said
    assert "peer sent no certificates" in said


def test_a_router_whose_certificate_has_expired_is_told_by_its_clients(fleet: Path) -> None:
    """A router of ours does not even start with it; one that runs, or zenohd, does."""
    endpoint = free_loopback_endpoint().replace("tcp/", "tls/")
    over = link(fleet, "expired").model_copy(update={"mode": "router", "listen": (endpoint,), "connect": ()})
    with pytest.raises(TlsError, match="certificate has expired"), open_session(over):
        pass
    with zenoh.open(zenoh_config(over)):
        said = why_refused(link(fleet, "drone", endpoint))
    assert said == f"{endpoint}: the router's certificate is refused: certificate has expired"


def test_a_client_says_why_its_router_does_not_let_it_in(fleet: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A router whose certificate is for another host than the one connected to."""
    endpoint = free_loopback_endpoint().replace("tcp/", "tls/")
    stop = threading.Event()
    given = link(fleet, "drone", endpoint.replace("127.0.0.1", "localhost"))
    with open_router((endpoint,), link=link(fleet, "ground")), caplog.at_level(logging.WARNING):
        threading.Timer(0.5, stop.set).start()
        with pytest.raises(StoppedError), open_session(given, stop):
            pass
        assert "the router's certificate is refused: Hostname mismatch" in caplog.text
        with open_session(given.model_copy(update={"verify_names": False})) as session:
            assert not session.is_closed()


@pytest.mark.parametrize(
    ("protocol", "reason"),
    [
        ("tls", "the router refuses this side: tlsv13 alert certificate required"),
        ("tcp", "the router expects TLS; write tls/127.0.0.1:"),
    ],
)
def test_status_and_doctor_tell_of_a_refusal_and_not_to_start_the_router(
    protocol: str, reason: str, fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spot3d.run.status._CONNECT_S", 0.2)
    endpoint = free_loopback_endpoint().replace("tcp/", "tls/")
    refused = link(fleet, None, endpoint.replace("tls/", f"{protocol}/"))
    with open_router((endpoint,), link=link(fleet, "ground")):
        (found,) = reached(refused, answered=False)
        with pytest.raises(ConnectionError) as told:
            show_status(refused, Console(quiet=True), watch=False)
    assert reason in found.text
    for said in (found.remedy, str(told.value)):
        assert "check [link] ca, certificate and key" in said
        assert "start" not in said


def test_a_router_without_tls_is_told_by_a_client_with_it(fleet: Path) -> None:
    endpoint = free_loopback_endpoint()
    with open_router((endpoint,)):
        said, remedy = why_unreached(link(fleet, "drone", endpoint.replace("tcp/", "tls/")), "start it")
    assert said.endswith(f"the router does not begin TLS; if it uses none, write {endpoint}")
    assert "check [link] ca" in remedy


@pytest.mark.parametrize(
    ("protocol", "reason", "may_be_refused"),
    [("tcp", "", False), ("tls", ": Connection refused", False), ("quic", "", True)],
)
def test_where_nobody_listens_the_router_is_to_be_started(
    protocol: str, reason: str, may_be_refused: bool, fleet: Path
) -> None:
    endpoint = free_loopback_endpoint().replace("tcp/", f"{protocol}/")
    said, remedy = why_unreached(link(fleet, "drone", endpoint), "start it")
    assert said.endswith(reason)
    assert remedy.startswith("start it")
    assert ("it may refuse this side" in remedy) == may_be_refused
