"""`spot3d results`: each stream of frames has a folder of its own, with all that was found in it."""

import errno
import json
import queue
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import zenoh
from dataflow_stages import Recording, frame_message

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.run import keep_results as keep_results_module
from spot3d.run import overview, stream_folder
from spot3d.run.keep_results import keep_results
from spot3d.run.results import RunResult, empty_snapshot, read_ply
from spot3d.run.stream_folder import StreamFolder, drop_oldest
from spot3d.trajectory import read_tum
from spot3d_schemas import Header, MapPoints, Message, Objects, Pose, Progress, encode, encoding, key
from waiting import wait_until

ROBOT = "keeper"
LIMIT_S = 60.0


@pytest.fixture
def router(tmp_path: Path) -> Iterator[zenoh.Session]:
    """A router, and `spot3d results` at it."""
    endpoint, stop = free_loopback_endpoint(), threading.Event()
    link = LinkSettings(robot=ROBOT, connect=(endpoint,), heartbeat=tmp_path / "beat")
    keeper = threading.Thread(target=keep_results, args=(link, tmp_path / "out", 2, stop))
    with open_router((endpoint,)) as session:
        keeper.start()
        try:
            yield session
        finally:
            stop.set()
            keeper.join(20)
            assert not keeper.is_alive()


def header(stream: str, stamp_ns: int) -> Header:
    return Header(robot=ROBOT, seq=0, stamp_ns=stamp_ns, frame_id="camera", stream=stream)


def put(session: zenoh.Session, topic: str, message: Message) -> None:
    session.put(key(ROBOT, topic), encode(message), encoding=encoding(type(message)))


def pose(stream: str, stamp_ns: int) -> Pose:
    return Pose(header=header(stream, stamp_ns), T_world_camera=np.eye(4), status="ok", reason="", provider="given")


def objects(stream: str, complete: bool) -> Objects:
    return Objects(
        header=header(stream, 50_000_000),
        objects=(),
        up=np.array([0.0, 0.0, 1.0]),
        frame_count=2,
        map_points=1,
        map_limit_reached=False,
        complete=complete,
    )


def test_every_stream_is_kept(router: zenoh.Session, tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def answer(query: zenoh.Query) -> None:
        asked.put(b"")
        points = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8), np.ones(1, np.float32), np.ones(1, np.uint32)
        message = MapPoints(
            header=header("first", 0), xyz=points[0], rgb=points[1], heat=points[2], frequency=points[3], total=1
        )
        query.reply(key(ROBOT, "fusion/map"), encode(message))

    router.declare_queryable(key(ROBOT, "fusion/map"), answer)
    frames = router.declare_publisher(key(ROBOT, "source/frame"))
    listening = router.declare_publisher(key(ROBOT, "fusion/objects"))
    wait_until(lambda: listening.matching_status.matching)

    put(router, "pose/pose", pose("first", 0))
    wait_until(lambda: frames.matching_status.matching)
    frame = frame_message(Recording(1)[0], ROBOT, 0)
    frames.put(encode(frame.model_copy(update={"header": header("first", 0)})))
    wait_until(lambda: not frames.matching_status.matching)
    put(router, "pose/pose", pose("first", 50_000_000))
    progress = Progress(header=header("first", 0), fused=2, skipped={}, last_stamp_ns=50_000_000, complete=True)
    put(router, "fusion/progress", progress)
    put(router, "fusion/objects", objects("first", complete=True))
    wait_until(lambda: any(out.glob("*-first/stream.json")))
    (folder,) = out.iterdir()
    assert read_tum(folder / "trajectory.txt")[0] == [0, 50_000_000]
    assert asked.qsize() == 1
    assert read_ply(folder / "heatmap.ply").total == 1
    told = json.loads((folder / "stream.json").read_text())
    assert (told["stream"], told["complete"], told["fused"], told["lost_poses"]) == ("first", True, 2, 0)
    assert json.loads((folder / "objects.json").read_text())["frame_count"] == 2
    assert (tmp_path / "beat").exists()

    # Fusion has gone on, and its map is of another stream.
    put(router, "fusion/objects", objects("later", complete=True))
    wait_until(lambda: any(out.glob("*-later/stream.json")))
    (later,) = out.glob("*-later")
    assert json.loads((later / "stream.json").read_text())["complete"] is True
    assert asked.qsize() == 2
    assert not (later / "heatmap.ply").exists()

    # A stream that is never completed is written as far as it was; with the third, the first goes.
    for stream in ("second", "third"):
        put(router, "fusion/objects", objects(stream, complete=False))
        wait_until(lambda stream=stream: any(out.glob(f"*-{stream}/objects.jsonl")))
    wait_until(lambda: any(out.glob("*-second/stream.json")))
    wait_until(lambda: len(list(out.iterdir())) == 2)
    assert json.loads(next(out.glob("*-second/stream.json")).read_text())["complete"] is False


def test_a_map_that_is_missing_in_a_complete_stream_is_told(
    router: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(keep_results_module, "_MAP_S", 1.0)
    busy = "no heatmap.ply: fusion refuses: too many requests for the map"

    def refuse(query: zenoh.Query) -> None:
        with query:
            query.reply_err(b"too many requests for the map")

    router.declare_queryable(key(ROBOT, "fusion/map"), refuse)
    listening = router.declare_publisher(key(ROBOT, "fusion/objects"))
    wait_until(lambda: listening.matching_status.matching)
    put(router, "fusion/objects", objects("first", complete=True))
    wait_until(lambda: any((tmp_path / "out").glob("*-first/stream.json")))
    (told,) = (tmp_path / "out").glob("*-first/stream.json")
    assert json.loads(told.read_text())["events"] == [busy]
    assert f"stream first has {busy}" in caplog.text


def test_a_folder_that_is_tried_again_is_that_of_the_present_stream(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not that of the stream before, whose last word comes late, nor one without a name."""
    waiting: list[Message] = []
    now_s = 0.0

    def progress(stream: str | None) -> Progress:
        named = header("any", 1).model_copy(update={"stream": stream})
        return Progress(header=named, fused=1, skipped={}, last_stamp_ns=1, complete=False)

    def hear(at_s: float, *streams: str | None) -> None:
        nonlocal now_s
        now_s = at_s
        waiting[:] = map(progress, streams)
        keeper._drain({"fusion/progress": None})

    def full(*_: object) -> StreamFolder:
        raise OSError(errno.ENOSPC, "No space left on device")

    clock = SimpleNamespace(monotonic=lambda: now_s, time=lambda: 1e9)
    monkeypatch.setattr(keep_results_module, "time", clock)
    monkeypatch.setattr(keep_results_module, "arrived", lambda *_: list(waiting))
    keeper = keep_results_module._Keeper(None, LinkSettings(robot=ROBOT), tmp_path, 100)
    keeper._seen = SimpleNamespace(look=lambda *_: None, forget=lambda: None, views=[])
    keeper._producers = SimpleNamespace(admit=lambda *_: True)
    with monkeypatch.context() as disk:
        disk.setattr(keep_results_module, "StreamFolder", full)
        hear(0, "first")
        hear(1, "second")
        hear(9, "second")
    hear(12, "first", None, "second")
    assert [path.name.rpartition("-")[2] for path in tmp_path.iterdir()] == ["second"]
    assert keeper._folder.stream == "second"
    keeper._folder.close()


def test_the_last_objects_of_a_stream_are_kept_that_come_with_poses_of_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keep_results_module, "arrived", lambda waiting, _: waiting)
    monkeypatch.setattr(keep_results_module, "asked_map", lambda *_: empty_snapshot())
    keeper = keep_results_module._Keeper(None, LinkSettings(robot=ROBOT), tmp_path, 100)
    keeper._seen = SimpleNamespace(look=lambda *_: None, forget=lambda: None, pose=lambda *_: None, views=[])
    keeper._producers = SimpleNamespace(admit=lambda *_: True)
    keeper._drain({"pose/pose": [pose("first", 0)], "fusion/objects": [objects("first", complete=False)]})
    poses = [pose("first", 50_000_000), pose("second", 0), pose("third", 0)]
    found = [objects("first", complete=True), objects("second", complete=True), objects("third", complete=False)]
    keeper._drain({"pose/pose": poses, "fusion/objects": found})
    told = [json.loads(path.read_text()) for path in tmp_path.glob("*/stream.json")]
    assert {item["stream"]: item["complete"] for item in told} == {"first": True, "second": True}
    first = next(tmp_path.glob("*-first/trajectory.txt"))
    assert read_tum(first)[0] == [0, 50_000_000]
    assert keeper._folder.stream == "third"
    keeper._folder.close()


def test_a_stream_is_told_complete_when_all_of_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told_before = []

    def draw(path: Path, *_: object) -> None:
        told_before.append((path.parent / "stream.json").exists())

    monkeypatch.setattr(stream_folder, "write_overview", draw)
    folder = StreamFolder(tmp_path, ROBOT, "first", 1e9)
    folder.update(1, RunResult(), True)
    folder.write(None, [])
    folder.close()
    assert told_before == [False]
    assert json.loads((folder.path / "stream.json").read_text())["complete"] is True


def test_a_picture_that_cannot_be_drawn_costs_no_other_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise TypeError("'NoneType' object is not subscriptable")

    monkeypatch.setattr(overview, "draw_overview", fail)
    folder = StreamFolder(tmp_path, ROBOT, "first", 1e9)
    folder.update(1, RunResult(), True)
    folder.write(empty_snapshot(), [])
    folder.close()
    told = json.loads((folder.path / "stream.json").read_text())
    assert told["complete"] is True
    assert told["events"] == ["overview.png cannot be drawn: TypeError: 'NoneType' object is not subscriptable"]
    assert (folder.path / "heatmap.ply").exists()
    assert not (folder.path / "overview.png").exists()


def test_why_poses_are_lost_is_kept(tmp_path: Path) -> None:
    """A camera program's mistake, as depth in another unit, shows nowhere else once its stages have ended."""
    folder = StreamFolder(tmp_path, ROBOT, "first", 1e9)
    folder.pose(1, None, "the depth image is empty")
    folder.write()
    folder.close()
    told = json.loads((folder.path / "stream.json").read_text())
    assert (told["lost_poses"], told["lost_because"]) == (1, "the depth image is empty")


def test_only_folders_of_streams_are_deleted(tmp_path: Path) -> None:
    (tmp_path / "of-somebody").mkdir()
    folders = [StreamFolder(tmp_path, ROBOT, f"stream{number}", 1e9 + number) for number in range(3)]
    for folder in folders:
        folder.close()
    assert drop_oldest(tmp_path, 2, folders[2].path) == [folders[0].path]
    assert sorted(path.name for path in tmp_path.iterdir())[-1] == "of-somebody"
    assert drop_oldest(tmp_path, 2, folders[2].path) == []


def test_a_stream_that_begins_in_1970_is_not_deleted_as_it_begins(tmp_path: Path) -> None:
    """A board without a battery for its clock."""
    folders = [
        StreamFolder(tmp_path, ROBOT, f"stream{number}", began_s) for number, began_s in enumerate((1e9, 2e9, 100))
    ]
    for folder in folders:
        folder.close()
    assert drop_oldest(tmp_path, 2, folders[2].path) == [folders[0].path]
    assert folders[2].path.exists()
