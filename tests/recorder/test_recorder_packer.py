"""The process that writes, as the recorder sees it, where its disk does not answer: SIGSTOP stands for that."""

import os
import select
import signal
import threading
from pathlib import Path

import pytest
from recordings import ROBOT, frame

from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.recorder import packer as packer_module
from spot3d.recorder import record as record_module
from spot3d.recorder.backlog import Backlog
from spot3d.recorder.packer import Packer
from spot3d.recorder.record import RECORDER, Recorded, record
from spot3d.settings import Settings
from spot3d_schemas import alive_key, encode
from waiting import wait_until

LIMIT_S = 20.0


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Packer]:
    """The handle of each process that a recorder has started."""
    handles: list[Packer] = []

    class Kept(Packer):
        def __init__(self, path: Path, backlog: Backlog, delivery: str) -> None:
            super().__init__(path, backlog, delivery)
            handles.append(self)

    monkeypatch.setattr(record_module, "Packer", Kept)
    return handles


def test_a_recorder_ends_though_the_process_that_writes_hangs(
    tmp_path: Path, made: list[Packer], monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint, stop, done = free_loopback_endpoint(), threading.Event(), list[Recorded]()
    link = LinkSettings(connect=(endpoint,), delivery="lossless")
    recorder = threading.Thread(
        target=lambda: done.append(record(Settings(link=link), tmp_path / "hung.mcap", ("source/frame",), stop)),
        daemon=True,
    )
    with open_router((endpoint,)) as session:
        recorder.start()
        there = alive_key(ROBOT, RECORDER)
        wait_until(lambda: any(reply.ok for reply in session.liveliness().get(there)), "the recorder is there", LIMIT_S)
        process = made[0]._process
        os.kill(process.pid, signal.SIGSTOP)
        publisher, payload = declare_publisher(session, "source/frame", link), encode(frame(0, 0))

        def takes_no_orders() -> bool:
            publisher.put(payload)
            return not select.select((), (made[0]._wire,), (), 0)[1]

        try:
            wait_until(takes_no_orders, "it takes no more orders", LIMIT_S)
            monkeypatch.setattr(packer_module, "PATIENCE_S", 0.5, raising=False)
            stop.set()
            recorder.join(LIMIT_S)
            assert not recorder.is_alive()
        finally:
            process.kill()
            recorder.join(LIMIT_S)
    assert done[0].error == ("the process that writes it hung for 0.5 s, and was killed; see whether its disk answers")
    assert process.returncode == -signal.SIGKILL


def test_a_recorder_does_not_wait_for_a_process_that_never_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("PATIENCE_S", "_LOOK_S"):
        monkeypatch.setattr(packer_module, limit, 0.0, raising=False)
    with pytest.raises(OSError, match="the process that writes it hung for 0 s, and was killed"):
        Packer(tmp_path / "hung.mcap", Backlog(2**20), "lossless")
