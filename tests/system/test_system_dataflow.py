"""The dataflow with real processes: nothing is lost, and nothing that happens on the way ends it."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import zenoh
from dataflow_stages import STAGES, Ear, Recording, Stages, frame_message, listening, playing, wait_alive, wait_gone

from commands import router_process
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.snapshot_writer import snapshot_path
from spot3d.fusion.snapshot import read_account
from spot3d_schemas import (
    TOPICS,
    End,
    Header,
    MapPoints,
    Message,
    Pose,
    Progress,
    Proposals,
    decode,
    encode,
    encoding,
    key,
)

HOUR_NS = 3600 * 10**9

SLOW_READER = """
import sys, zenoh
from zenoh.handlers import FifoChannel
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
subscriber = session.declare_subscriber(sys.argv[2], FifoChannel(1))
print("ready", flush=True)
subscriber.recv()
print("stuck", flush=True)
sys.stdin.read()
"""


@pytest.fixture(scope="module")
def lossless(router: tuple[zenoh.Session, str]) -> Iterator[tuple[zenoh.Session, Stages, Ear]]:
    """All stages of one robot, lossless; each test plays a recording of its own hour."""
    session, endpoint = router
    link = LinkSettings(
        robot="calm", connect=(endpoint,), delivery="lossless", health_interval_s=0.2, credit_timeout_s=3.0
    )
    with listening(session, "calm") as ear, Stages(link) as stages:
        stages.start(*STAGES)
        wait_alive(session, "calm", set(STAGES))
        yield session, stages, ear
        assert stages.stop() == dict.fromkeys(STAGES, 0), "SIGTERM ends every stage in order"


def play(link: LinkSettings, recording: Recording, ear: Ear) -> tuple[int, dict[str, int]]:
    """Play a recording to its end, with patience for a busy machine; returns what was fused and skipped by then."""
    with playing(link.model_copy(update={"credit_timeout_s": 60.0}), recording) as thread:
        thread.join(120)
        assert not thread.is_alive()
    complete = ear.wait_complete(recording)
    return complete.fused, complete.skipped


def counts(ear: Ear) -> tuple[int, dict[str, int]]:
    """Fused and skipped so far."""
    return (ear.progress.fused, ear.progress.skipped) if ear.progress else (0, {})


def test_lossless_fuses_every_frame(lossless: tuple[zenoh.Session, Stages, Ear]) -> None:
    session, stages, ear = lossless
    recording = Recording(40)
    assert play(stages.link, recording, ear) == (40, {})
    ear.wait(lambda: bool(ear.objects) and ear.objects[-1].complete)
    progress: list[Progress] = ear.heard["fusion/progress"]
    # Each stamp once, or again where a first update compiles its kernels.
    assert list(dict.fromkeys(item.last_stamp_ns for item in progress)) == recording.stamps_ns
    # Every 0.4 s of capture time, and at the end.
    stamps = [update.header.stamp_ns // 1_000_000 for update in ear.objects]
    assert stamps == [400, 800, 1200, 1600, 1950]
    assert [update.frame_count for update in ear.objects] == [9, 17, 25, 33, 40]
    assert [update.complete for update in ear.objects] == [False] * 4 + [True]
    trace = [hop.stage for hop in ear.objects[0].header.trace]
    assert trace == ["source", "proposals", "heatmap", "fusion"]
    for stage in STAGES:
        inputs = {"heatmap": 80, "segments": 80, "fusion": 121}.get(stage, 40)
        ear.wait(lambda stage=stage, inputs=inputs: (health := ear.health(stage)) and health.received >= inputs)
        health = ear.health(stage)
        assert health is not None
        assert (health.drops, health.errors, health.stage) == ({}, 0, stage)
        assert health.latency_ms_p50 is not None
    replies = list(session.get(key("calm", "fusion/map") + "?limit=100", timeout=20))
    points = decode(replies[0].ok.payload.to_bytes(), MapPoints)
    assert len(points.xyz) == 100 < points.total


def test_malformed_messages_stop_nobody(lossless: tuple[zenoh.Session, Stages, Ear]) -> None:
    session, stages, ear = lossless
    good: dict[str, Message] = {
        "source/frame": frame_message(Recording(1)[0], "calm", 0),
        "proposals/boxes": Proposals(header=_header(), boxes=np.zeros((0, 5), np.float32)),
        "pose/pose": Pose(header=_header(), T_world_camera=np.eye(4), status="ok", reason="", provider="other"),
        "source/end": End(header=_header(), frames_sent=1),
    }
    before = {stage: health.errors if (health := ear.health(stage)) else 0 for stage in STAGES}
    for topic in (*good, "heatmap/heat"):
        stated = encoding(TOPICS[topic].message)
        publisher = session.declare_publisher(key("calm", topic), congestion_control=zenoh.CongestionControl.BLOCK)
        with publisher:
            for payload in (b"", b"\x00", b"nonsense" * 100, b"\xdf\xff\xff\xff\xff"):
                publisher.put(payload, encoding=stated)
            if topic in good:
                payload = encode(good[topic])
                publisher.put(payload[: len(payload) // 2], encoding=stated)
                publisher.put(payload, encoding="application/msgpack;schema=spot3d.Frame/9")
                publisher.put(payload.replace(b"spot3d.", b"spot9d."), encoding=stated)
            publisher.delete()
    few = {"pose": 8, "proposals": 8, "heatmap": 16, "segments": 13, "fusion": 21}
    for stage, refused in few.items():
        ear.wait(
            lambda stage=stage, refused=refused: (
                (health := ear.health(stage)) is not None and health.errors >= before[stage] + refused
            )
        )
        health = ear.health(stage)
        assert health is not None
        assert health.errors == before[stage] + refused
        assert "refused" in health.last_error
    assert play(stages.link, Recording(5, HOUR_NS), ear) == (5, {})


def _header() -> Header:
    return Header(robot="calm", seq=0, stamp_ns=1, frame_id="camera")


def test_duplicates_and_stragglers_are_dropped(lossless: tuple[zenoh.Session, Stages, Ear]) -> None:
    session, _, ear = lossless
    recording = Recording(5, 2 * HOUR_NS)
    wait_gone(session, "calm", "source")
    fused, skipped = counts(ear)
    before = {stage: dict(health.drops) if (health := ear.health(stage)) else {} for stage in STAGES}
    with session.declare_publisher(
        key("calm", "source/frame"), congestion_control=zenoh.CongestionControl.BLOCK
    ) as publisher:
        for seq, index in enumerate((0, 1, 1, 2, 0, 2, 3, 4)):
            message = frame_message(recording[index], "calm", seq)
            publisher.put(encode(message), encoding=encoding(type(message)))
    ear.wait(lambda: ear.fused >= fused + 5)
    assert counts(ear) == (fused + 5, skipped)
    for stage in ("pose", "proposals", "heatmap"):
        expected = {"source/frame duplicate stamp": 2, "source/frame out of order": 1}

        def new(stage: str = stage) -> dict[str, int]:
            health = ear.health(stage)
            drops = health.drops if health else {}
            return {reason: n - before[stage].get(reason, 0) for reason, n in drops.items()}

        ear.wait(lambda new=new, expected=expected: expected.items() <= new().items())


def test_a_reader_that_is_stuck_and_dies_costs_nothing(
    router: tuple[zenoh.Session, str], lossless: tuple[zenoh.Session, Stages, Ear]
) -> None:
    _, stages, ear = lossless
    recording = Recording(30, 3 * HOUR_NS)
    reader = subprocess.Popen(
        [sys.executable, "-c", SLOW_READER, router[1], key("calm", "source/frame")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert reader.stdout is not None
    try:
        assert reader.stdout.readline() == b"ready\n"
        link = stages.link.model_copy(update={"credit_timeout_s": 60.0})
        with playing(link, recording) as source:
            assert reader.stdout.readline() == b"stuck\n"
            ear.wait(lambda: ear.reached(recording.stamps_ns[2]))
            reader.kill()
            source.join(120)
            assert not source.is_alive()
    finally:
        reader.kill()
        reader.communicate()
    complete = ear.wait_complete(recording)
    assert (complete.fused, complete.skipped) == (30, {})


def test_nobody_waits_for_an_onlooker_where_the_stages_have_a_socket_of_their_own(tmp_path: Path) -> None:
    """One that is stuck for good, at the stages' default router, would end any lossless run."""
    elsewhere, socket = free_loopback_endpoint(), tmp_path / "stages"
    meeting = f"unixsock-stream/{socket}"
    link = LinkSettings(robot="spared", connect=(meeting,), delivery="lossless", credit_timeout_s=60.0)
    with ExitStack() as stack:
        stack.enter_context(router_process("--stages", str(socket), listen=elsewhere))
        reader = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", SLOW_READER, elsewhere, key("spared", "source/frame")],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
        )
        stack.callback(reader.kill)
        assert reader.stdout is not None
        assert reader.stdout.readline() == b"ready\n"
        session = stack.enter_context(open_session(LinkSettings(connect=(meeting,))))
        ear = stack.enter_context(listening(session, "spared"))
        stages = stack.enter_context(Stages(link))
        stages.start(*STAGES)
        wait_alive(session, "spared", set(STAGES))
        # 14 MB of frames, more than the connection's buffers take on most machines.
        assert play(link, Recording(150), ear) == (150, {})
        assert reader.stdout.readline() == b"stuck\n"
        assert reader.poll() is None


def test_reset_is_idempotent(lossless: tuple[zenoh.Session, Stages, Ear]) -> None:
    session, stages, ear = lossless
    for _ in range(2):
        reply = next(iter(session.get(key("calm", "fusion/reset"), timeout=20)))
        progress = decode(reply.ok.payload.to_bytes(), Progress)
        assert (progress.fused, progress.skipped) == (0, {})
    assert play(stages.link, Recording(10, 4 * HOUR_NS), ear) == (10, {})
    ear.wait(lambda: any(update.complete and update.frame_count == 10 for update in ear.objects[-1:]))


def test_a_fusion_that_says_that_it_is_busy_is_waited_for(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    link = LinkSettings(robot="busy", connect=(endpoint,), delivery="lossless", in_flight=1, credit_timeout_s=2.0)
    recording, answer = Recording(2, HOUR_NS), key("busy", "fusion/progress")

    def say(fused: int, last_stamp_ns: int, complete: bool = False) -> None:
        header = Header(robot="busy", seq=0, stamp_ns=0, frame_id="camera")
        words = Progress(header=header, fused=fused, skipped={}, last_stamp_ns=last_stamp_ns, complete=complete)
        session.put(answer, encode(words), encoding=encoding(Progress))

    with listening(session, "busy", "source/frame", "source/end", "source/health") as ear:
        with playing(link, recording, wait_for=()) as source:
            for number, stamp_ns in enumerate(recording.stamps_ns):
                ear.wait(lambda number=number: len(ear.heard["source/frame"]) > number)
                for _ in range(14):  # 4.2 s, more than twice the patience
                    say(number, 0 if number == 0 else recording.stamps_ns[number - 1])
                    time.sleep(0.3)
                assert len(ear.heard["source/frame"]) == number + 1
                say(number + 1, stamp_ns)
            ear.wait(lambda: len(ear.heard["source/end"]) > 0)
            say(2, recording.stamps_ns[-1], complete=True)
            source.join(20)
            assert not source.is_alive()
        ear.wait(lambda: (health := ear.health("source")) is not None and health.published > 2)
        assert "lost in flight" not in ear.heard["source/health"][-1].drops


def test_a_killed_fusion_does_not_hang_a_lossless_run(lossless: tuple[zenoh.Session, Stages, Ear]) -> None:
    session, stages, ear = lossless
    recording = Recording(20, 5 * HOUR_NS)
    link = stages.link.model_copy(update={"credit_timeout_s": 1.0})
    with playing(link, recording, rate_hz=10.0) as source:
        ear.wait(lambda: ear.reached(recording.stamps_ns[2]))
        stages.kill("fusion")
        wait_alive(session, "calm", {"source", *STAGES} - {"fusion"})
        heard = len(ear.heard["fusion/progress"])
        stages.start("fusion")
        ear.wait(lambda: len(ear.heard["fusion/progress"]) > heard)
        source.join(120)
        assert not source.is_alive()
    # The new fusion joined in: it answered the end.
    ear.wait_complete(recording)
    wait_alive(session, "calm", set(STAGES))


def test_live_goes_on_without_a_killed_stage(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    link = LinkSettings(robot="wild", connect=(endpoint,), health_interval_s=0.2)
    with listening(session, "wild", "pose/pose") as ear, Stages(link) as stages:
        stages.start(*STAGES)
        with playing(link, Recording(10_000), wait_for=STAGES, rate_hz=15.0):
            ear.wait(lambda: ear.fused >= 5)
            stages.kill("proposals")
            wait_alive(session, "wild", {"source", *STAGES} - {"proposals"})
            fused, poses = ear.fused, len(ear.heard["pose/pose"])
            ear.wait(lambda: len(ear.heard["pose/pose"]) >= poses + 10)
            stages.start("proposals")
            ear.wait(lambda: ear.fused >= fused + 5)
        progress: list[Progress] = ear.heard["fusion/progress"]
        fused_each = [item.fused for item in progress]
        assert fused_each == sorted(fused_each), "what was fused stays fused"
        assert {"no heat"} <= set(progress[-1].skipped) <= {"no heat", "no pose"}
        assert stages.stop() == dict.fromkeys(STAGES, 0)


def test_a_fusion_that_is_stopped_keeps_all_that_it_has_fused(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    link = LinkSettings(robot="kept", connect=(endpoint,), health_interval_s=0.2, snapshot_interval_s=3600)
    with listening(session, "kept") as ear, Stages(link) as stages:
        stages.start(*STAGES)
        with playing(stages.link, Recording(10_000), wait_for=STAGES, rate_hz=15.0):
            # The first snapshot comes with the first update; for the next one it is an hour too early.
            ear.wait(lambda: len(ear.objects) >= 2 and ear.fused >= 25)
            fused, epoch = ear.fused, ear.objects[-1].epoch
            assert stages.end("fusion") == 0
            told, _ = read_account(snapshot_path(stages.link, "fusion"))
            assert told.epoch == epoch
            assert told.fused >= fused
            heard = len(ear.objects)
            stages.start("fusion")
            ear.wait(lambda: len(ear.objects) > heard)
            assert ear.objects[-1].epoch == epoch
            assert ear.objects[-1].frame_count > told.fused


def test_two_robots_on_one_router_do_not_mix(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    links = [LinkSettings(robot=robot, connect=(endpoint,), delivery="lossless") for robot in ("left", "right")]
    with (
        listening(session, "left", "pose/pose") as left,
        listening(session, "right", "pose/pose") as right,
        Stages(links[0]) as a,
        Stages(links[1]) as b,
    ):
        a.start("pose")
        b.start("pose")
        wait_alive(session, "left", {"pose"})
        wait_alive(session, "right", {"pose"})
        recordings = Recording(8), Recording(5, HOUR_NS)
        for link, recording in zip(links, recordings, strict=True):
            for seq, frame in enumerate(recording):
                message = frame_message(frame, link.robot, seq)
                session.put(
                    key(link.robot, "source/frame"),
                    encode(message),
                    encoding=encoding(type(message)),
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )
        for ear, recording, robot in zip((left, right), recordings, ("left", "right"), strict=True):
            ear.wait(lambda ear=ear, recording=recording: len(ear.heard["pose/pose"]) >= len(recording))
            poses: list[Pose] = ear.heard["pose/pose"]
            assert [pose.header.stamp_ns for pose in poses] == recording.stamps_ns
            assert {pose.header.robot for pose in poses} == {robot}
