"""A camera whose stamps go back amid a run: the run goes on with its new stream, and keeps what it saw before."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from dataflow_stages import Recording, frame_message

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.run.collector import Collector
from spot3d.run.earlier_streams import MOST
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.overview import OverviewFrames
from spot3d.run.report import RunReport, report_document
from spot3d.run.results import MapSnapshot, RunResult, empty_snapshot, read_ply, write_results
from spot3d.trajectory import read_tum
from spot3d_schemas import Header, Health, MapPoints, Message, Objects, Pose, Progress, encode, encoding, key

ROBOT, S = "rewound", 10**9
LIMIT_S = 20.0


class Said:
    """What fusion and pose say of a stream, through a router to a run's collector."""

    def __init__(self, session: zenoh.Session, collector: Collector, seen: OverviewFrames) -> None:
        self.session, self.collector, self.seen = session, collector, seen

    def frame(self, stream: str, stamp_ns: int) -> None:
        frame = frame_message(Recording(1)[0], ROBOT, 0)
        self._put("source/frame", frame.model_copy(update={"header": self._header(stream, stamp_ns)}))

    def pose(self, stream: str, stamp_ns: int, lost: bool = False) -> None:
        status = "lost" if lost else "ok"
        T, header = np.eye(4), self._header(stream, stamp_ns)
        self._put("pose/pose", Pose(header=header, T_world_camera=T, status=status, reason="", provider="kiss"))

    def progress(self, stream: str, stamp_ns: int, fused: int, **skipped: int) -> None:
        counts = {"fused": fused, "skipped": skipped, "last_stamp_ns": stamp_ns, "complete": False}
        self._put("fusion/progress", Progress(header=self._header(stream, stamp_ns), **counts))

    def objects(self, stream: str, stamp_ns: int, frames: int) -> None:
        counts = {"frame_count": frames, "map_points": 1, "map_limit_reached": False, "complete": False}
        up, header = np.array([0.0, 0.0, 1.0]), self._header(stream, stamp_ns)
        self._put("fusion/objects", Objects(header=header, objects=(), up=up, **counts))

    def health(self, topic: str, stage: str, pid: int, **events: int) -> None:
        known = {"uptime_s": 0.0, "received": 0, "published": 0, "drops": {}, "events": events, "errors": 0}
        unknown = dict.fromkeys(("rate_hz", "latency_ms_p50", "latency_ms_p99", "step_ms_p50", "step_ms_p99"))
        used = {"last_error": "", "cpu_s": 0.0, "rss_bytes": 0, "threads": 1}
        header = self._header("first", 1)
        self._put(topic, Health(header=header, stage=stage, pid=pid, **known, **unknown, **used))

    def until(self, what: Callable[[], bool]) -> None:
        end_s = time.monotonic() + LIMIT_S
        while not what():
            assert time.monotonic() < end_s
            self.collector.drain()
            time.sleep(0.01)

    def _header(self, stream: str, stamp_ns: int) -> Header:
        return Header(robot=ROBOT, seq=0, stamp_ns=stamp_ns, frame_id="camera", stream=stream)

    def _put(self, topic: str, message: Message) -> None:
        self.session.put(key(ROBOT, topic), encode(message), encoding=encoding(type(message)))


@pytest.fixture
def said(tmp_path: Path) -> Iterator[Said]:
    seen = OverviewFrames(ROBOT)
    with (
        open_router((free_loopback_endpoint(),)) as session,
        GrowingFiles(tmp_path) as files,
        Collector(session, ROBOT, "first", files, seen) as collector,
    ):
        yield Said(session, collector, seen)


def point(x: float) -> MapSnapshot:
    one = np.ones(1)
    colour = np.zeros((1, 3), np.uint8)
    return MapSnapshot(np.full((1, 3), x, np.float32), colour, one.astype(np.float32), one.astype(np.uint32), 1)


def frame_counts(updates: Path) -> list[int]:
    return [json.loads(line)["frame_count"] for line in updates.read_text().splitlines()]


def test_a_stage_of_another_name_is_no_stage_of_the_run(said: Said) -> None:
    """Two processes, one after the other, that say they are a detector: neither is known, nor ends the run."""
    collector = said.collector
    for pid in (1, 2):
        said.health("proposals/health", "detector", pid)
    said.health("proposals/health", "proposals", 3)
    said.until(lambda: "proposals" in collector.health)
    assert list(collector.health) == ["proposals"]


def test_what_stages_counted_before_they_were_started_again_counts(said: Said) -> None:
    collector = said.collector
    for stage, event in (("fusion", "keyframes"), ("heatmap", "accepted")):
        said.health(f"{stage}/health", stage, 1, **{event: 120})
        said.health(f"{stage}/health", stage, 2, **{event: 3})
        said.health(f"{stage}/health", stage, 3)
    said.until(lambda: [totals.latest.pid for totals in collector.health.values()] == [3, 3])
    report = RunReport("realsense", "processes", 0, (0, 0))
    collector.fill(report, {})
    assert (report.keyframes, report.proposals) == (123, {"accepted": 123})


def test_what_came_before_and_what_comes_after_are_both_kept(said: Said, tmp_path: Path) -> None:
    collector = said.collector
    said.pose("first", 100 * S)
    said.pose("first", 101 * S, lost=True)
    said.objects("first", 101 * S, 7)
    said.progress("first", 101 * S, 7, lost_pose=1)
    said.until(lambda: collector.progress is not None and len(collector.poses) == 2)
    write_results(tmp_path, RunResult(points=point(1.0)))  # as a run does every ten seconds
    assert collector.news() == []

    said.pose("second", 5 * S)
    said.pose("first", 102 * S)
    said.until(lambda: len(collector.poses) == 3)
    assert collector.stream == "first", "fusion has the say of which stream it is in"
    said.objects("first", 101 * S, 8)  # its last word, which comes with the first of the next
    said.progress("second", 5 * S, 2)
    said.pose("second", 6 * S)
    said.objects("second", 6 * S, 2)
    said.until(lambda: collector.objects is not None and collector.stream == "second")
    said.until(lambda: len(collector.poses) == 2)

    place = "streams/1"
    assert collector.news() == [f"the camera begins another stream; earlier results are in {place}"]
    assert [item.stamp_ns for item in collector.result(empty_snapshot()).trajectory] == [5 * S, 6 * S]
    assert collector.result(empty_snapshot()).frame_count == 2
    assert read_tum(tmp_path / place / "trajectory.txt")[0] == [100 * S, 102 * S]
    assert read_tum(tmp_path / "trajectory.txt")[0] == [5 * S, 6 * S]
    assert json.loads((tmp_path / place / "objects.json").read_text())["frame_count"] == 8
    assert frame_counts(tmp_path / place / "objects.jsonl") == [7, 8]
    assert frame_counts(tmp_path / "objects.jsonl") == [2]
    assert read_ply(tmp_path / place / "heatmap.ply").xyz[0, 0] == 1
    assert not (tmp_path / "heatmap.ply").exists(), "of another world"

    report = RunReport("realsense", "processes", 0, (0, 0))
    collector.fill(report, {})
    document = report_document(report, RunResult())
    assert document["frames"]["fused"] == 9
    assert document["frames"]["skipped"] == {"lost_pose": 1}
    assert document["frames"]["lost_poses"] == 1
    assert [stretch["from_ns"] for stretch in document["frames"]["lost"]] == [101 * S]
    (earlier,) = document["earlier_streams"]
    assert (earlier["folder"], earlier["fused"], earlier["skipped"]) == (place, 7, {"lost_pose": 1})


def test_what_is_late_of_a_stream_before_counts_no_more(said: Said) -> None:
    collector = said.collector
    said.progress("first", 100 * S, 7)
    said.progress("second", 5 * S, 2)
    said.progress("first", 100 * S, 8)
    said.progress("second", 6 * S, 3)
    said.until(lambda: collector.progress is not None and collector.progress.fused == 3)
    said.until(lambda: collector.counts()[0] == 11)
    assert collector.stream == "second"


def test_of_many_streams_the_last_are_kept_and_all_frames_are_counted(said: Said, tmp_path: Path) -> None:
    collector = said.collector
    for number in range(MOST + 3):
        said.progress(f"s{number}", 5 * S, 2)
        said.until(lambda number=number: collector.stream == f"s{number}")
    kept = sorted(int(place.name) for place in (tmp_path / "streams").iterdir())
    assert kept == list(range(4, MOST + 4)), "of 23 that are over"
    report = RunReport("realsense", "processes", 0, (0, 0))
    collector.fill(report, {})
    assert [document["folder"] for document in report.earlier_streams] == [f"streams/{number}" for number in kept]
    said.until(lambda: collector.counts()[0] == 2 * (MOST + 3))
    assert "streams/3 is deleted, since at most 20 streams are kept" in collector.news()


def test_a_map_of_another_stream_is_not_taken(said: Said) -> None:
    def answer(query: zenoh.Query) -> None:
        header = Header(robot=ROBOT, seq=0, stamp_ns=0, frame_id="camera", stream="second")
        one = point(2.0)
        arrays = {"xyz": one.xyz, "rgb": one.rgb, "heat": one.heat, "frequency": one.frequency}
        message = MapPoints(header=header, **arrays, total=1)
        query.reply(key(ROBOT, "fusion/map"), encode(message), encoding=encoding(MapPoints))

    with said.session.declare_queryable(key(ROBOT, "fusion/map"), answer):
        assert said.collector.snapshot(LIMIT_S).total == 0, "the map is of the second stream, the objects are not"
        said.progress("second", 5 * S, 2)
        said.until(lambda: said.collector.stream == "second")
        assert said.collector.snapshot(LIMIT_S).total == 1
    assert said.collector.snapshot(LIMIT_S).total == 1, "fusion does not answer any more: nothing is lost by that"
    said.progress("third", 6 * S, 2)
    said.until(lambda: said.collector.stream == "third")
    assert said.collector.snapshot(LIMIT_S).total == 0


def test_pictures_are_of_the_stream_that_is_followed(said: Said) -> None:
    def sent(stream: str) -> bool:
        said.frame(stream, 5 * S)
        return said.seen.first is not None

    said.until(lambda: sent("first"))
    assert said.seen.first is not None
    assert said.seen.first.stamp_ns == 5 * S
    assert said.seen.views == [], "its pose is not known"
    said.pose("first", 5 * S)
    said.until(lambda: len(said.seen.views) == 1)
    said.progress("second", 5 * S, 2)
    said.until(lambda: said.collector.stream == "second")
    assert said.seen.views == []
    assert said.seen.first is None
