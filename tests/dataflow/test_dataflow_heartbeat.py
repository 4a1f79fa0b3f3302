"""The heartbeat: written while a stage turns, no more where its work lies still, gone where it ends as it should."""

import os
import threading
import time
from pathlib import Path

import pytest
from pydantic import ValidationError

from spot3d.dataflow import node as node_module
from spot3d.dataflow.heartbeat import Heartbeat
from spot3d.dataflow.node import Node
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import End, Header, encode, encoding, key
from waiting import wait_until


def test_a_folder_that_cannot_be_written_ends_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    heartbeat = Heartbeat(tmp_path / "nowhere" / "beat")
    heartbeat.beat()
    heartbeat.beat()
    heartbeat.close()
    assert len(caplog.records) == 1


def test_a_stage_that_leaves_its_work_lying_beats_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_module, "STUCK_S", 0.3)
    beat = tmp_path / "beat"
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="beating", connect=(endpoint,), health_interval_s=0.05, heartbeat=beat)
    header = Header(robot="beating", seq=0, stamp_ns=0, frame_id="camera")
    end = End(header=header, frames_sent=1)
    with open_router((endpoint,)) as session, Node("fusion", link, threading.Event(), ("source/end",)) as node:
        # Nothing to do: it beats although nobody reads.
        time.sleep(0.5)
        wait_until(beat.exists)
        beaten_s, process = map(int, beat.read_text().split())
        assert 0 <= time.clock_gettime(time.CLOCK_BOOTTIME) - beaten_s < 30
        assert process == os.getpid()
        heard: list[object] = []
        subscriber = session.declare_subscriber(key("beating", "fusion/health"), heard.append)
        wait_until(lambda: bool(heard))
        publisher = session.declare_publisher(key("beating", "source/end"), encoding=encoding(End))
        wait_until(lambda: publisher.matching_status.matching)
        publisher.put(encode(end))
        wait_until(lambda: node._inbox.waiting)
        time.sleep(0.3)
        beat.unlink(missing_ok=True)
        heard.clear()
        time.sleep(1.2)
        assert not beat.exists()
        assert not heard, "nor does it say that it is well"
        node.turn()
        wait_until(beat.exists)
        assert node.next() is not None
        wait_until(lambda: bool(heard))
        subscriber.undeclare()
    assert not beat.exists()


@pytest.mark.parametrize("interval_s", [1.5, 24.0, float("inf")])
def test_health_comes_often_enough_for_those_who_watch_it(interval_s: float) -> None:
    """Containers whose heartbeat is 20 s old are killed; the dashboard asks after a second and a half."""
    with pytest.raises(ValidationError, match=r"health_interval_s\n.*less than or equal to 1"):
        LinkSettings(health_interval_s=interval_s)


def test_a_disk_that_was_full_for_a_moment_ends_no_heartbeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("spot3d.dataflow.heartbeat._INTERVAL_S", 0.0)
    path = tmp_path / "later" / "beat"
    heartbeat = Heartbeat(path)
    heartbeat.beat()
    heartbeat.beat()
    path.parent.mkdir()
    heartbeat.beat()
    assert path.read_text().split()[1] == str(os.getpid())
    assert len(caplog.records) == 1
