import mmap
import os
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
