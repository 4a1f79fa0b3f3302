"""Shared memory between namespaces: used where both sides see the same, otherwise the network; frames come whole."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from spot3d.dataflow.process_use import SINGLE_THREADED

FRAMES = 20
LIMIT_S = 60.0
NOBODY = 65534
NAMESPACE = ("--net", "--pid", "--fork", "--kill-child", "--mount", "--mount-proc")
"""As a container has them; a Unix socket is the way from one to another."""

SAY = """
import sys, time
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
link = LinkSettings(robot="boxed", connect=(sys.argv[1],))
with open_session(link) as session:
    publisher, number = declare_publisher(session, "source/frame", link), 0
    print("open", flush=True)
    while True:
        publisher.put(bytes([number % 256]) * 1_000_000)
        number += 1
        time.sleep(1 / 30)
"""
HEAR = """
import os, sys
from spot3d.dataflow.endpoints import declare_subscriber
from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
link = LinkSettings(robot="boxed", connect=(sys.argv[1],))
os.setuid(int(sys.argv[2]))
shared = whole = 0
with open_session(link) as session:
    subscriber = declare_subscriber(session, "source/frame", link)
    while whole < int(sys.argv[3]):
        payload = subscriber.recv().payload
        data = intact_bytes(payload)
        if data is not None:
            assert len(data) == 1_000_000 and data == data[:1] * len(data), "a torn frame"
            shared, whole = shared + (payload.as_shm() is not None), whole + 1
print(shared)
"""


def python(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", program, *arguments]


@contextmanager
def running(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | SINGLE_THREADED) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def meeting() -> Iterator[str]:
    """A router with its publisher, which share /dev/shm with this process."""
    if os.geteuid() != 0 or shutil.which("unshare") is None or not os.access("/dev/shm", os.W_OK):
        pytest.skip("namespaces need root, unshare and /dev/shm")
    tried = subprocess.run(["unshare", *NAMESPACE, "true"], capture_output=True, text=True, timeout=20, check=False)
    if tried.returncode != 0:
        pytest.skip(f"this machine allows no namespaces: {tried.stderr.strip()}")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="spot3d-")))
        folder.chmod(0o755)  # for those who run as another user
        socket = folder / "stages"
        command = [sys.executable, "-m", "spot3d", "router", "--stages", str(socket), "--listen", "tcp/127.0.0.1:0"]
        endpoint = f"unixsock-stream/{socket}"
        for one in (command, python(SAY, endpoint)):
            process = stack.enter_context(running(one))
            assert process.stdout is not None
            assert process.stdout.readline()
        yield endpoint


def by_memory(*command: str) -> int:
    """How many of a reader's frames came through shared memory; all of them came whole."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_namespaces_share_memory_where_they_see_the_same(meeting: str) -> None:
    """Those of network and processes, as containers have them, change nothing, and take nothing from those outside."""
    reader = python(HEAR, meeting, "0", str(FRAMES))
    assert by_memory(*reader) > 0
    # Zenoh deletes the memory of dead processes at each start: this one sees no other process.
    assert by_memory("unshare", *NAMESPACE, *reader) > 0
    assert by_memory(*reader) > 0


def test_who_sees_other_memory_or_may_not_read_it_gets_frames_by_the_network(meeting: str) -> None:
    reader = python(HEAR, meeting, "0", str(FRAMES))
    own = ["sh", "-c", 'mount -t tmpfs tmpfs /dev/shm && exec "$@"', "sh", *reader]
    assert by_memory("unshare", *NAMESPACE, *own) == 0
    assert by_memory(*python(HEAR, meeting, str(NOBODY), str(FRAMES))) == 0
