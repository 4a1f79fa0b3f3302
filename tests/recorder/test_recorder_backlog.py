import mmap
import os
import time
from collections.abc import Iterator

import pytest

from spot3d.recorder.backlog import Backlog

MB = 2**20


@pytest.fixture
def backlog() -> Iterator[Backlog]:
    made = Backlog(32 * MB)
    yield made
    os.close(made.file)


def test_images_are_skipped_before_what_is_small(backlog: Backlog) -> None:
    taken = [backlog.put("source/frame", 0, seq, bytes(4 * MB), wait=False) for seq in range(6)]
    assert taken == [True, True, True, True, False, False]
    assert not backlog.has_room(4 * MB)
    assert backlog.has_room(100)
    assert backlog.put("pose/pose", 0, 0, bytes(100), wait=False)
    heard = [backlog.get(0) for _ in range(6)]
    assert [item and (item.topic, item.sequence) for item in heard] == [
        *(("source/frame", seq) for seq in range(4)),
        ("pose/pose", 0),
        None,
    ]
    times = [item.log_ns for item in heard if item is not None]
    assert times == sorted(times)
    assert not backlog.has_room(4 * MB), "their bytes are still being read"
    backlog.done()
    backlog.done()
    assert backlog.put("source/frame", 0, 6, bytes(4 * MB), wait=False), "there is room again"
    backlog.close()
    assert not backlog.put("pose/pose", 0, 1, b"", wait=True), "nobody waits for room in one that is closed"


def test_its_bytes_are_seen_by_whoever_has_the_memory(backlog: Backlog) -> None:
    theirs = mmap.mmap(backlog.file, 0)
    for seq in range(40):
        data = bytes([seq]) * (3 * MB + seq)
        assert backlog.put("source/frame", 0, seq, data, wait=False)
        item = backlog.get(0)
        assert item is not None
        assert theirs[item.at : item.at + item.size] == data
        if seq:
            backlog.done()


@pytest.mark.parametrize("step_ns", [-3600 * 10**9, 54 * 365 * 86400 * 10**9])
def test_messages_are_logged_in_their_pace_though_the_clock_is_set(
    backlog: Backlog, monkeypatch: pytest.MonkeyPatch, step_ns: int
) -> None:
    wall_ns = time.time_ns
    backlog.put("pose/pose", 0, 0, b"before", wait=False)
    monkeypatch.setattr(time, "time_ns", lambda: wall_ns() + step_ns)
    time.sleep(0.05)
    backlog.put("pose/pose", 0, 1, b"after", wait=False)
    before, after = backlog.get(0), backlog.get(0)
    assert before is not None
    assert after is not None
    assert 0 <= wall_ns() - before.log_ns < 60 * 10**9
    assert 0.04 < 1e-9 * (after.log_ns - before.log_ns) < 60
