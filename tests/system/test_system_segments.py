"""The objects of single keyframes with real processes: the same as in one process, live, and from another segmenter."""

import threading
import time

import numpy as np
import pytest
import zenoh
from dataflow_stages import STAGES, Ear, Recording, Stages, listening, playing, wait_alive
from zenoh.handlers import FifoChannel

from spot3d.dataflow.conversion import frame_segments, segments_message
from spot3d.dataflow.settings import LinkSettings
from spot3d.frame_segments import FrameSegments
from spot3d.pipeline import PipelineStep, run_pipeline
from spot3d.settings import load_settings
from spot3d.source.process import MissingStagesError
from spot3d.source.process import run as run_source
from spot3d.source.sequence import FrameSequence
from spot3d.source.sequences import open_source
from spot3d.source.settings import SourceSettings
from spot3d_schemas import Frame, Segments, alive_key, decode, encode, encoding, key

FRAMES = 40
"""Two seconds of a camera that moves by 2 cm a second."""


def in_process(recording: FrameSequence) -> dict[int, FrameSegments]:
    """The keyframes' segments of one process, by stamp."""
    found: dict[int, FrameSegments] = {}

    def note(step: PipelineStep) -> None:
        if step.segments is not None:
            found[step.frame.stamp_ns] = step.segments

    run_pipeline(recording, load_settings(overrides={"pose": {"provider": "given"}}), note)
    return found


def keyframes(ear: Ear) -> int:
    """Keyframes that the fusion of now has taken in."""
    health = ear.health("fusion")
    return 0 if health is None else health.events.get("keyframes", 0)


def test_processes_give_the_same_segments_as_one_process(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    link = LinkSettings(
        robot="calm", connect=(endpoint,), delivery="lossless", health_interval_s=0.2, credit_timeout_s=60.0
    )
    recording = open_source("scene", frames=20, halved=True)
    alone = in_process(recording)
    with listening(session, "calm", "segments/segments") as ear, Stages(link) as stages:
        stages.start(*STAGES)
        with playing(link, recording) as source:
            source.join(150)
            assert not source.is_alive()
        ear.wait(lambda: ear.progress is not None and ear.progress.complete)
        ear.wait(lambda: keyframes(ear) == len(alone))
        answers: list[Segments] = ear.heard["segments/segments"]
        assert [answer.header.stamp_ns for answer in answers] == list(recording.stamps_ns), (
            "every frame is answered, in order"
        )
        assert [hop.stage for hop in answers[0].header.trace] == ["source", "proposals", "heatmap", "segments"]
        together = {answer.header.stamp_ns: frame_segments(answer) for answer in answers if answer.keyframe}
        assert list(together) == list(alone)
        assert len(alone) >= 2
        for stamp, expected in alone.items():
            found = together[stamp]
            assert found is not None
            assert found.camera == expected.camera
            for name in ("labels", "heat", "planes", "stands_on"):
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert min(len(item) for item in alone.values()) > 0, "there is something to compare"
        health = ear.health("fusion")
        assert health is not None
        assert (health.drops, health.errors) == ({}, 0)


def test_a_killed_segments_stage_does_not_hang_a_lossless_run(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    link = LinkSettings(
        robot="brave", connect=(endpoint,), delivery="lossless", health_interval_s=0.2, credit_timeout_s=1.0
    )
    recording = Recording(FRAMES)
    with listening(session, "brave") as ear, Stages(link) as stages:
        stages.start(*STAGES)
        with playing(link, recording, rate_hz=20.0) as source:
            ear.wait(lambda: ear.fused >= 5)
            stages.kill("segments")
            wait_alive(session, "brave", {"source", *STAGES} - {"segments"})
            stages.start("segments")
            source.join(120)
            assert not source.is_alive()
        progress = ear.wait_complete(recording)
        assert (progress.fused, progress.skipped) == (FRAMES, {}), "what has no segments is fused without them"
        ear.wait(lambda: (health := ear.health("fusion")) is not None and health.drops.get("no segments", 0) > 0)


def test_live_keyframes_find_their_frames_and_nobody_waits_for_them(router: tuple[zenoh.Session, str]) -> None:
    session, endpoint = router
    link = LinkSettings(robot="wild", connect=(endpoint,), health_interval_s=0.2)
    with listening(session, "wild") as ear, Stages(link) as stages:
        stages.start(*STAGES)
        with playing(link, Recording(10_000), wait_for=STAGES, rate_hz=20.0):
            ear.wait(lambda: keyframes(ear) >= 3)
            stages.kill("segments")
            wait_alive(session, "wild", {"source", *STAGES} - {"segments"})
            fused = ear.fused
            ear.wait(lambda: ear.fused >= fused + 20)
            before = keyframes(ear)
            stages.start("segments")
            ear.wait(lambda: keyframes(ear) >= before + 2)
        assert stages.stop() == dict.fromkeys(STAGES, 0)


def test_another_segmenter_takes_the_place_of_the_stage(router: tuple[zenoh.Session, str]) -> None:
    """It labels every third frame at full size, without heat or pose, and says of the others that they are none."""
    session, endpoint = router
    link = LinkSettings(
        robot="learned", connect=(endpoint,), delivery="lossless", health_interval_s=0.2, credit_timeout_s=60.0
    )
    others = tuple(stage for stage in STAGES if stage != "segments")
    recording = Recording(12)

    def answer(frames: zenoh.Subscriber) -> None:
        with session.declare_publisher(
            key("learned", "segments/segments"),
            encoding=encoding(Segments),
            congestion_control=zenoh.CongestionControl.BLOCK,
        ) as publisher:
            for seq in range(len(recording)):
                frame = decode(frames.recv().payload.to_bytes(), Frame)
                header = frame.header.with_hop("segments", 1, 2).model_copy(update={"seq": seq})
                if seq % 3:
                    publisher.put(encode(segments_message(header, None)))
                    continue
                labels = (frame.colour[..., 0] > 150).astype(np.uint8)
                ones, none = np.ones(1, np.float32), np.full(1, -1, np.int8)
                camera = recording.intrinsics
                publisher.put(
                    encode(segments_message(header, FrameSegments(labels, ones, np.zeros((0, 4)), none, camera)))
                )

    with listening(session, "learned") as ear, Stages(link) as stages:
        stages.start(*others)
        frames = session.declare_subscriber(key("learned", "source/frame"), FifoChannel(8))
        segmenter = threading.Thread(target=answer, args=(frames,))
        segmenter.start()
        with (
            session.liveliness().declare_token(alive_key("learned", "segments")),
            playing(link, recording) as source,
        ):
            source.join(120)
            assert not source.is_alive()
        segmenter.join(20)
        ear.wait(lambda: ear.progress is not None and ear.progress.complete)
        assert (ear.progress.fused, ear.progress.skipped) == (12, {}) if ear.progress else False
        ear.wait(lambda: keyframes(ear) == 4)


def test_a_lossless_source_says_that_the_segments_stage_is_missing(
    router: tuple[zenoh.Session, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    session, endpoint = router
    monkeypatch.setattr("spot3d.source.process.START_LIMIT_S", 0.5)
    link = LinkSettings(robot="alone", connect=(endpoint,), delivery="lossless")
    tokens = [session.liveliness().declare_token(alive_key("alone", stage)) for stage in STAGES if stage != "segments"]
    start_s = time.monotonic()
    with pytest.raises(MissingStagesError, match="segments of robot"):
        run_source(link, SourceSettings(), Recording(1))
    assert time.monotonic() - start_s < 10
    for token in tokens:
        token.undeclare()
