"""Streams of frames: another recording is another scene, and nobody else's word counts, whoever intrudes."""

import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest
import zenoh
from dataflow_stages import LIMIT_S, STAGES, Ear, Recording, Stages, frame_message, listening, playing, wait_alive

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.frame import RgbdFrame
from spot3d.run.collector import Collector
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.report import RunReport
from spot3d.source.process import run as run_source
from spot3d.source.sequence import Note
from spot3d.source.settings import SourceSettings
from spot3d.trajectory import read_tum
from spot3d_schemas import Header, Heat, MapPoints, Pose, Progress, decode, encode, encoding, key

S = 10**9


@pytest.fixture(scope="module")
def live() -> Iterator[tuple[zenoh.Session, Stages, Ear]]:
    """All stages of one robot, live."""
    endpoint = free_loopback_endpoint()
    with open_router((endpoint,)) as session:
        link = LinkSettings(robot="roving", connect=(endpoint,), health_interval_s=0.2, snapshot_interval_s=0.5)
        with listening(session, "roving", "pose/pose") as ear, Stages(link) as stages:
            stages.start(*STAGES)
            wait_alive(session, "roving", set(STAGES))
            yield session, stages, ear


def source(link: LinkSettings, recording: Recording) -> AbstractContextManager[threading.Thread]:
    """A camera without an end, in a thread of this process."""
    return playing(link, recording, rate_hz=10.0)


class RewoundCamera:
    """A camera of twenty frames a second, whose stamps go back after some."""

    def __init__(self, frames: int, again: int) -> None:
        self._frames = [*Recording(frames, 6000 * S), *Recording(again, 50 * S)]

    def stream(self, stop: threading.Event, _note: Note) -> Iterator[RgbdFrame]:
        for frame in self._frames:
            stop.wait(0.05)
            yield frame


def put(session: zenoh.Session, topic: str, message: Pose | Heat) -> None:
    where = key("roving", topic)
    session.put(
        where, encode(message), encoding=encoding(type(message)), congestion_control=zenoh.CongestionControl.BLOCK
    )


def test_a_source_that_starts_again_with_older_stamps_is_another_scene(live) -> None:
    _, stages, ear = live
    with source(stages.link, Recording(10_000, 1000 * S)):
        ear.wait(lambda: ear.fused >= 5 and bool(ear.objects))
    first, objects = ear.stream, ear.objects[-1]
    assert first is not None
    assert objects.header.stream == first
    assert objects.epoch is not None
    with source(stages.link, Recording(10_000, 5 * S)):
        ear.wait(lambda: ear.stream not in (None, first) and ear.fused >= 5)
        ear.wait(lambda: ear.objects_of_now is not None)
        second = ear.objects[-1]
        assert second.epoch != objects.epoch
        # Nothing of the scene before is in the map that is told; what was fused is told after that, and elsewhere.
        ear.wait(lambda: second.frame_count <= ear.fused)
        assert second.frame_count < 100
        assert {pose.epoch for pose in ear.heard["pose/pose"] if pose.header.stream == first} == {first}


def test_a_run_goes_on_with_a_camera_whose_stamps_go_back(live, tmp_path: Path) -> None:
    session, stages, _ = live
    camera, report = RewoundCamera(40, 200), RunReport("camera", "processes", 0, (0, 0))
    with (
        GrowingFiles(tmp_path) as files,
        Collector(session, "roving", "first", files) as collector,
    ):
        run_source(stages.link, SourceSettings(), camera, stop=threading.Event(), stream="first")
        end_s = time.monotonic() + LIMIT_S
        while collector.objects is None or not (collector.stream != "first" and collector.objects.complete):
            assert time.monotonic() < end_s
            collector.drain()
            time.sleep(0.02)
        collector.fill(report, {})
        (earlier,), health = report.earlier_streams, collector.health["source"].latest
        points = collector.snapshot(20).total
        told = collector.news()
    assert told == ["the camera begins another stream; earlier results are in streams/1"]
    assert earlier["fused"] + sum(earlier["skipped"].values()) == 40
    # No frame goes uncounted.
    assert health.drops.keys() <= {"stray stamp in the input", "between two streams in the input"}
    assert report.fused + sum(report.skipped.values()) == 240
    assert report.fused > 40
    assert points > 0
    assert (
        max(read_tum(tmp_path / "trajectory.txt")[0])
        < 100 * S
        <= min(read_tum(tmp_path / "streams/1/trajectory.txt")[0])
    )


def test_a_reset_amid_a_stream_begins_the_map_anew_and_goes_on(live) -> None:
    session, stages, ear = live
    with source(stages.link, Recording(10_000, 1500 * S)):
        before = ear.stream
        ear.wait(lambda: ear.stream != before and ear.fused >= 5 and ear.objects_of_now is not None)
        stream, epoch = ear.stream, ear.objects[-1].epoch
        reply = next(iter(session.get(key("roving", "fusion/reset"), timeout=20)))
        assert decode(reply.ok.payload.to_bytes(), Progress).fused == 0
        ear.wait(lambda: ear.objects[-1].epoch != epoch and ear.objects[-1].frame_count >= 3)
        assert ear.stream == stream


def test_nobody_else_is_heard_while_the_source_is_there(live) -> None:
    session, stages, ear = live
    with source(stages.link, Recording(10_000, 2000 * S)):
        before = ear.stream
        ear.wait(lambda: ear.stream != before and ear.fused >= 3)
        ours = ear.stream
        with source(stages.link, Recording(10_000, 9 * S)):
            ear.wait(lambda: "more than one process publishes source/frame" in _state(ear, "pose"))
            fused = ear.fused
            ear.wait(lambda: ear.fused >= fused + 5)
            # An intruder's frame, hours ahead, and a pose and a heat in step with ours, from afar.
            frame = frame_message(Recording(1, 9000 * S)[0], "roving", 0)
            session.put(key("roving", "source/frame"), encode(frame), encoding=encoding(type(frame)))
            stamp_ns = ear.progress.last_stamp_ns + 1000 if ear.progress else 0
            header = Header(robot="roving", seq=0, stamp_ns=stamp_ns, frame_id="camera")
            far = np.eye(4)
            far[0, 3] = 1e6
            put(session, "pose/pose", Pose(header=header, T_world_camera=far, status="ok", reason="", provider="x"))
            image = frame.model_dump(include={"intrinsics", "depth_scale", "colour", "depth"})
            heat = np.full(frame.depth.shape, 255, np.uint8)
            put(session, "heatmap/heat", Heat(**image, header=header, heat=heat, accepted=1, masked=0, rejected=0))
            ear.wait(lambda: "more than one process publishes pose/pose" in _state(ear, "fusion"))
            fused = ear.fused
            ear.wait(lambda: ear.fused >= fused + 5)
        assert ear.stream == ours
        answer = next(iter(session.get(key("roving", "fusion/map"), timeout=20)))
        points = decode(answer.ok.payload.to_bytes(), MapPoints)
        assert np.abs(points.xyz).max() < 10
        health = ear.health("fusion")
        assert health is not None
        assert health.drops["pose/pose of a second producer"] == 1


def test_a_crowd_that_asks_for_the_map_stops_nobody(live) -> None:
    session, stages, ear = live
    with source(stages.link, Recording(10_000, 3000 * S)):
        before = ear.stream
        ear.wait(lambda: ear.stream != before and ear.fused >= 3)
        fused = ear.fused
        crowd = [session.get(key("roving", "fusion/map"), timeout=30) for _ in range(100)]
        answers = [reply for replies in crowd for reply in replies]
        assert any(answer.ok is not None for answer in answers)
        told = [answer.err.payload.to_string() for answer in answers if answer.err is not None]
        assert all("ask again" in text for text in told)
        assert len(answers) == 100, "nobody waits in vain"
        ear.wait(lambda: ear.fused >= fused + 10, 20)


def test_a_second_fusion_is_named_and_not_heard(live) -> None:
    _, stages, ear = live
    first = stages.processes["fusion"]
    with source(stages.link, Recording(10_000, 4000 * S)):
        before = ear.stream
        ear.wait(lambda: ear.stream != before and ear.fused >= 3)
        stages.start("fusion")
        try:
            ear.wait(lambda: "2 processes of fusion are running" in _state(ear, "fusion"))
        finally:
            stages.kill("fusion")
            stages.processes["fusion"] = first


def test_a_killed_fusion_goes_on_with_its_map(live) -> None:
    session, stages, ear = live
    with source(stages.link, Recording(10_000, 5000 * S)):
        earlier = ear.stream
        ear.wait(lambda: ear.stream != earlier and ear.fused >= 20 and ear.objects_of_now is not None)
        ear.wait(lambda: _event(ear, "fusion", "snapshots") >= 2)
        fused, before = ear.fused, ear.objects[-1]
        stages.kill("fusion")
        heard = len(ear.objects)
        stages.start("fusion")
        ear.wait(lambda: len(ear.objects) >= heard + 3)
        after = ear.objects[heard]
        assert (after.epoch, after.header.stream) == (before.epoch, before.header.stream)
        assert after.frame_count > fused - 15, "at most the last second is lost"
        assert after.map_points > 0.9 * before.map_points
    wait_alive(session, "roving", set(STAGES))


def _event(ear: Ear, stage: str, kind: str) -> int:
    health = ear.health(stage)
    return health.events.get(kind, 0) if health else 0


def _state(ear: Ear, stage: str) -> str:
    health = ear.health(stage)
    return health.state if health else ""
