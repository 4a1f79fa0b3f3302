from spot3d.recorder.backlog import Backlog

MB = 2**20


def test_images_are_skipped_before_what_is_small() -> None:
    backlog = Backlog(32 * MB)
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
    assert backlog.has_room(4 * MB)
    times = [item.log_ns for item in heard if item is not None]
    assert times == sorted(times)
    assert backlog.put("source/frame", 0, 6, bytes(4 * MB), wait=False), "there is room again"
    backlog.close()
    assert not backlog.put("pose/pose", 0, 1, b"", wait=True), "nobody waits for room in one that is closed"
