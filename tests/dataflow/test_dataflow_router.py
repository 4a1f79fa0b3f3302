"""The router's process: it ends soon, whatever has become of those that are connected to it."""

import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from commands import router_process
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d.security.access import AccessSettings, access_control
from waiting import wait_until

ONLOOKER = """
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("images", zenoh.handlers.FifoChannel(1))
    print("ready", flush=True)
    time.sleep(600)
"""
MEGABYTES = 20
"""More than the buffers of a connection within one host take."""


def test_a_router_that_is_not_there_is_told_of_in_words(caplog: pytest.LogCaptureFixture) -> None:
    endpoint = free_loopback_endpoint()
    with pytest.raises(StoppedError), open_session(LinkSettings(connect=(endpoint,)), patience_s=0.1):
        pass
    said = "retrying: no answer; start one there (spot3d router)"
    assert caplog.messages == [f"no router at {endpoint} yet, {said}"]


@pytest.mark.parametrize(
    ("endpoint", "robots", "said"),
    [
        ("tcp/192.0.2.7:7447", (), r"requested address .*; check that it is an address of this device$"),
        (f"unixsock-stream/{{tmp}}/{'x' * 108}", (), r": path must be shorter than SUN_LEN$"),
        ("tcp/127.0.0.1:0#so_sndbuf=abc", (), r": Unknown TCP write buffer size argument: abc$"),
        ("tcp/127.0.0.1:0", ("drone", "drone"), r": id 'drone says' is repeated$"),
    ],
)
def test_a_remedy_is_given_only_for_what_it_helps_against(
    endpoint: str, robots: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    access = access_control(AccessSettings(robots=robots)) if robots else None
    with pytest.raises(ConnectionError, match=said), open_router((endpoint.format(tmp=tmp_path),), access=access):
        pass


def test_it_waits_for_no_onlooker_that_stands_still(tmp_path: Path) -> None:
    """Its connection would linger for ten seconds: as long as `docker compose stop` waits before it kills."""
    elsewhere, socket = free_loopback_endpoint(), tmp_path / "stages"
    with ExitStack() as stack:
        router = stack.enter_context(router_process("--stages", str(socket), listen=elsewhere))
        onlooker = stack.enter_context(
            subprocess.Popen([sys.executable, "-c", ONLOOKER, elsewhere], stdout=subprocess.PIPE, text=True)
        )
        stack.callback(onlooker.kill)
        assert onlooker.stdout is not None
        assert onlooker.stdout.readline() == "ready\n"
        with open_session(LinkSettings(connect=(f"unixsock-stream/{socket}",))) as session:
            block = zenoh.CongestionControl.BLOCK
            images = session.declare_publisher("images", congestion_control=block)
            last = session.declare_subscriber("last", zenoh.handlers.FifoChannel(1))
            wait_until(lambda: images.matching_status.matching)
            onlooker.send_signal(signal.SIGSTOP)
            for _ in range(MEGABYTES):
                images.put(bytes(10**6))
            # What is put behind has come back when the router has had it all.
            session.put("last", b"", congestion_control=block)
            wait_until(lambda: last.try_recv() is not None)
        stopped_s = time.monotonic()
        router.send_signal(signal.SIGTERM)
        assert router.wait(60) == 0
        assert time.monotonic() - stopped_s < 6
