"""The source's process: what it refuses to play, and what it does about what comes in between."""

import queue
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from dataflow_stages import Recording, listening, playing
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.dataflow import node as node_module
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d.source.image_limit import refuse_large_images
from spot3d.source.player import Sent
from spot3d.source.process import run
from spot3d.source.sequence import CAMERA_LOST, CAMERA_MISSING, Note
from spot3d.source.settings import SourceSettings
from spot3d_schemas import End, Frame, Header, Health, Progress, alive_key, encode, encoding, key
from waiting import wait_until


def camera(width: int, height: int) -> Intrinsics:
    return Intrinsics(500.0, 500.0, width / 2, height / 2, width, height)


@pytest.mark.parametrize("size", [(2048, 2048), (8192, 512)])
def test_images_of_the_largest_size_are_played(size: tuple[int, int]) -> None:
    refuse_large_images(camera(*size), halved=False)


@pytest.mark.parametrize(
    ("size", "halved", "remedy"),
    [
        ((2049, 2048), False, "use --half"),
        ((2049, 2048), True, "scale colour and depth images down"),
        ((8193, 400), False, "use --half"),
        ((400, 8193), True, "scale colour and depth images down"),
        ((4098, 4096), False, "scale colour and depth images down"),
    ],
)
def test_larger_images_are_refused_in_one_sentence(size: tuple[int, int], halved: bool, remedy: str) -> None:
    said = (
        rf"^images of {size[0]} x {size[1]} pixels are too large for a message, which holds 4194304 pixels and 8192 a "
        rf"side; {remedy}$"
    )
    with pytest.raises(SourceError, match=said):
        refuse_large_images(camera(*size), halved)


class LargeRecording(Recording):
    intrinsics = camera(2592, 1944)


class LargeCamera:
    """A camera of five million pixels."""

    def stream(self, stop: threading.Event, note: Note) -> Iterator[RgbdFrame]:
        large = camera(2592, 1944)
        yield RgbdFrame(1, np.zeros((*large.shape, 3), np.uint8), np.zeros(large.shape, np.uint16), 0.001, large)


def test_large_images_end_the_source_before_any_is_sent() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="large", connect=(endpoint,))
    with open_router((endpoint,)):
        for sequence in (LargeRecording(1), LargeCamera()):
            with pytest.raises(SourceError, match=r"2592 x 1944 pixels are too large for a message.*use --half"):
                run(link, SourceSettings(), sequence, stop=threading.Event())


class BentRecording(Recording):
    """The pose of one frame is no rotation, and the stamp of another lies before 1970."""

    def __init__(self) -> None:
        super().__init__(4)
        self.stamps_ns.insert(0, -1)

    def true_pose(self, index: int) -> NDArray[np.float64]:
        return np.diag([1.0, 1.0, 1.1 if index == 2 else 1.0, 1.0])


def test_frames_that_no_message_holds_are_counted_and_the_others_played() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="bent", connect=(endpoint,), credit_timeout_s=0.1)
    with open_router((endpoint,)) as session, listening(session, "bent", "source/frame", "source/health") as ear:
        run(link, SourceSettings(), BentRecording(), stop=threading.Event())
        frames: list[Frame] = ear.heard["source/frame"]
        health: list[Health] = ear.heard["source/health"]
        ear.wait(lambda: len(frames) == 3 and bool(health) and health[-1].errors == 2)
    assert [frame.header.stamp_ns for frame in frames] == [0, 100_000_000, 150_000_000]
    assert [frame.header.seq for frame in frames] == [0, 1, 2], "nobody misses what was never sent"
    assert health[-1].drops == {"cannot be sent": 2}
    why = health[-1].last_error
    said = "the frame at 50000000 ns cannot be sent: frame.T_world_camera: the 3x3 part is not a rotation"
    assert why.startswith(said), why


class GappyRecording(Recording):
    """The pose of one frame is missing."""

    def true_pose(self, index: int) -> NDArray[np.float64] | None:
        return None if index == 1 else super().true_pose(index)


def test_frames_without_a_pose_among_others_are_counted() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="gappy", connect=(endpoint,), credit_timeout_s=0.1)
    with open_router((endpoint,)) as session, listening(session, "gappy", "source/health") as ear:
        run(link, SourceSettings(), GappyRecording(3), stop=threading.Event())
        health: list[Health] = ear.heard["source/health"]
        ear.wait(lambda: bool(health) and bool(health[-1].events), 20)
    assert health[-1].events == {"frames without a true pose": 1}


class UnposedRecording(Recording):
    """No frame has a pose, and whoever asks for them searches all."""

    searched = 0

    @property
    def has_true_poses(self) -> bool:
        self.searched += 1
        return False

    def true_pose(self, index: int) -> None:
        return None


def test_a_recording_without_poses_is_searched_for_them_once() -> None:
    endpoint, recording = free_loopback_endpoint(), UnposedRecording(3)
    link = LinkSettings(robot="unposed", connect=(endpoint,), credit_timeout_s=0.1)
    with open_router((endpoint,)) as session, listening(session, "unposed", "source/end") as ear:
        run(link, SourceSettings(), recording, stop=threading.Event())
        ear.wait(lambda: bool(ear.heard["source/end"]), 20)
    assert ear.heard["source/end"][0].frames_sent == 3
    assert recording.searched == 1


def test_a_recording_in_which_a_clock_was_set_goes_on_at_once_and_says_so() -> None:
    """Live, where frames keep their pace; the first one with the new time is in doubt."""
    endpoint, recording, year_ns = free_loopback_endpoint(), Recording(8), 365 * 86400 * 10**9
    recording.stamps_ns[3:] = [year_ns + stamp_ns for stamp_ns in recording.stamps_ns[3:]]
    link = LinkSettings(robot="set", connect=(endpoint,), credit_timeout_s=0.1, health_interval_s=0.05)
    with (
        open_router((endpoint,)) as session,
        listening(session, "set", "source/end", "source/health") as ear,
        playing(link, recording),
    ):
        health: list[Health] = ear.heard["source/health"]
        ear.wait(lambda: bool(ear.heard["source/end"]) and bool(health) and bool(health[-1].events), 20)
    assert ear.heard["source/end"][0].frames_sent == 7
    assert (health[-1].events, health[-1].drops) == ({"gap": 1}, {"stray stamp in the input": 1})


class ScriptedCamera:
    """A camera that does what it is told to: gives a frame, or says something."""

    def __init__(self) -> None:
        self.script: queue.SimpleQueue[RgbdFrame | tuple[str, str]] = queue.SimpleQueue()

    def stream(self, stop: threading.Event, note: Note) -> Iterator[RgbdFrame | None]:
        while not stop.is_set():
            try:
                told = self.script.get(timeout=0.02)
            except queue.Empty:
                yield None
                continue
            if isinstance(told, RgbdFrame):
                yield told
            else:
                note(*told)


def test_a_camera_that_is_waited_for_is_what_is_wrong_until_its_frames_come() -> None:
    endpoint, camera, frames = free_loopback_endpoint(), ScriptedCamera(), Recording(2)
    link = LinkSettings(robot="unplugged", connect=(endpoint,), health_interval_s=0.05)
    with (
        open_router((endpoint,)) as session,
        listening(session, "unplugged", "source/health") as ear,
        playing(link, camera),
    ):
        health: list[Health] = ear.heard["source/health"]

        def wait_for_state(state: str) -> None:
            ear.wait(lambda: bool(health) and health[-1].state == state, 20)

        camera.script.put((CAMERA_MISSING, "no camera is plugged in"))
        wait_for_state("no camera is plugged in")
        camera.script.put(("camera found", "streaming"))
        ear.wait(lambda: "camera found" in health[-1].events, 20)
        wait_for_state("no camera is plugged in")
        camera.script.put(frames[0])
        wait_for_state("")
        camera.script.put((CAMERA_LOST, "it is gone"))
        wait_for_state("it is gone")
        camera.script.put(frames[1])
        wait_for_state("")


def test_a_source_that_waits_for_its_camera_does_not_hang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_module, "STUCK_S", 0.3)
    endpoint, beat = free_loopback_endpoint(), tmp_path / "beat"
    link = LinkSettings(robot="patient", connect=(endpoint,), health_interval_s=0.05, heartbeat=beat)
    header = Header(robot="patient", seq=0, stamp_ns=0, frame_id="camera")
    words = Progress(header=header, fused=1, skipped={}, last_stamp_ns=0, complete=False)
    with (
        open_router((endpoint,)) as session,
        listening(session, "patient", "source/health") as ear,
        playing(link, ScriptedCamera()),
    ):
        health: list[Health] = ear.heard["source/health"]
        ear.wait(lambda: bool(health), 20)
        session.put(key("patient", "fusion/progress"), encode(words), encoding=encoding(Progress))
        ear.wait(lambda: health[-1].received == 1, 20)
        time.sleep(0.5)
        beat.unlink(missing_ok=True)
        wait_until(beat.exists, "it beats, though it only waits", 10)


def test_a_source_that_continues_a_stream_counts_what_was_sent_of_it_before() -> None:
    """Also where nothing is left to send: the end is the one that its stream has."""
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="again", connect=(endpoint,), credit_timeout_s=0.1)
    earlier = Sent(frames=7, stamp_ns=300_000_000)
    with open_router((endpoint,)) as session, listening(session, "again", "source/end") as ear:
        ends: list[End] = ear.heard["source/end"]
        for frames, told in ((3, (10, 450_000_000)), (0, (7, 300_000_000))):
            ends.clear()
            recording = Recording(frames, 350_000_000)
            run(link, SourceSettings(), recording, stop=threading.Event(), stream="s", wait_for=(), earlier=earlier)
            ear.wait(lambda: bool(ends), 20)
            assert {(end.frames_sent, end.header.stamp_ns) for end in ends} == {told}


def test_a_source_says_for_whom_it_waits_and_begins_when_they_are_there(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="early", connect=(endpoint,), credit_timeout_s=0.1)
    with (
        open_router((endpoint,)) as session,
        listening(session, "early", "source/frame") as ear,
        session.liveliness().declare_token(alive_key("early", "pose")),
        playing(link, Recording(2), wait_for=("pose", "heatmap", "fusion")),
    ):
        wait_until(lambda: "waiting for heatmap, fusion (at most 180 s)" in caplog.text, "it says so", 20)
        assert not ear.heard["source/frame"]
        with (
            session.liveliness().declare_token(alive_key("early", "heatmap")),
            session.liveliness().declare_token(alive_key("early", "fusion")),
        ):
            ear.wait(lambda: len(ear.heard["source/frame"]) == 2, 20)
    assert caplog.text.count("waiting for") == 1


@pytest.mark.parametrize("delivery", ["live", "lossless"])
def test_a_camera_whose_stamps_go_back_ends_its_stream_and_begins_another(
    delivery: Literal["live", "lossless"],
) -> None:
    endpoint, camera = free_loopback_endpoint(), ScriptedCamera()
    before, after = Recording(3, 100 * 10**9), Recording(6, 5 * 10**9)
    link = LinkSettings(robot="rewound", connect=(endpoint,), delivery=delivery, health_interval_s=0.05)
    with (
        open_router((endpoint,)) as session,
        listening(session, "rewound", "source/frame", "source/end", "source/health") as ear,
        session.liveliness().declare_token(alive_key("rewound", "fusion")),
        playing(link, camera, wait_for=()),
    ):
        frames: list[Frame] = ear.heard["source/frame"]
        ends: list[End] = ear.heard["source/end"]
        health: list[Health] = ear.heard["source/health"]

        def fused(header: Header, count: int, complete: bool) -> None:
            counts = {"fused": count, "skipped": {}, "last_stamp_ns": header.stamp_ns, "complete": complete}
            word = Progress(header=header, **counts)
            session.put(key("rewound", "fusion/progress"), encode(word), encoding=encoding(Progress))

        ear.wait(lambda: bool(health), 20)

        def played(images: Sequence[RgbdFrame]) -> None:
            for frame in images:  # one by one: live, a frame may push out another
                count = len(frames)
                camera.script.put(frame)
                ear.wait(lambda count=count: len(frames) > count, 20)

        played(list(before))
        fused(frames[2].header, 3, complete=False)
        for frame in list(after)[:3]:  # the first is in doubt, those after it come while the stream is to be completed
            camera.script.put(frame)
        counted = {"stray stamp in the input": 1, "between two streams in the input": 2}
        ear.wait(lambda: bool(ends) and bool(health) and health[-1].drops == counted, 20)
        assert ends[0].frames_sent == 3
        assert ends[0].header.stream == frames[0].header.stream
        assert ends[0].header.stamp_ns == before.stamps_ns[-1]
        fused(ends[0].header, 3, complete=True)
        ear.wait(lambda: health[-1].received == 2, 20)
        played(list(after)[3:])
    assert [frame.header.stamp_ns for frame in frames[3:]] == after.stamps_ns[3:]
    assert len({frame.header.stream for frame in frames}) == len({frame.header.stream for frame in frames[3:]}) + 1 == 2
