"""A recording on the wire again: in its time, under any name, and never beside the stages themselves."""

import os
import pty
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from recordings import ROBOT, damage_second_chunk, frame, write_recording

from spot3d.cli.options import CommandError
from spot3d.cli.recordings import play as play_command
from spot3d.dataflow.pace import Pace
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.recorder.keyboard import on_key
from spot3d.recorder.mcap_contents import McapContents, open_mcap
from spot3d.recorder.mcap_writer import McapWriter
from spot3d.recorder.play import Playing, StageAliveError, play
from spot3d.recorder.profile import PROFILE
from spot3d_schemas import End, Frame, Header, Pose, alive_key, decode, encoding, key

PERIOD_NS = 50_000_000
HOUR_NS = 3600 * 10**9
LIMIT_S = 30.0


@pytest.fixture
def contents(tmp_path: Path) -> McapContents:
    """Eight frames with poses, 50 ms apart, and an end that counts a hundred."""
    sent = []
    for seq in range(8):
        header = Header(robot=ROBOT, seq=seq, stamp_ns=PERIOD_NS * seq, frame_id="camera")
        pose = Pose(header=header, T_world_camera=np.eye(4), status="ok", reason="", provider="given")
        sent += [("source/frame", 0.05 * seq, frame(seq, PERIOD_NS * seq)), ("pose/pose", 0.05 * seq + 0.01, pose)]
    end = End(header=header, frames_sent=100)
    path = tmp_path / "eight.mcap"
    write_recording(path, [sent[:7], [*sent[7:], ("source/end", 0.4, end)]])
    return open_mcap(path)


@pytest.fixture
def link() -> LinkSettings:
    """Lossless, so that frames are not dropped where the machine is busy."""
    return LinkSettings(connect=(free_loopback_endpoint(),), delivery="lossless")


@pytest.fixture
def session(link: LinkSettings) -> Iterator[zenoh.Session]:
    with open_router(link.connect) as opened:
        yield opened


class Ear:
    """What is said under a robot's name, with the monotonic time."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self.heard: list[tuple[float, str, str, bytes]] = []
        self.changed = threading.Condition()
        self.subscriber = session.declare_subscriber(f"spot3d/{robot}/**", self.hear)

    def hear(self, sample: zenoh.Sample) -> None:
        with self.changed:
            said = time.monotonic(), str(sample.key_expr), str(sample.encoding), sample.payload.to_bytes()
            self.heard.append(said)
            self.changed.notify_all()

    def wait(self, count: int) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.heard) >= count, LIMIT_S), f"heard {len(self.heard)}"


def untimed(message: Frame) -> Frame:
    """Without its trace."""
    return message.model_copy(update={"header": message.header.model_copy(update={"trace": ()})})


def test_all_of_it_comes_in_its_time(contents: McapContents, link: LinkSettings, session: zenoh.Session) -> None:
    ear = Ear(session, ROBOT)
    sent = play(contents, Playing(tuple(contents.topics)), link)
    assert sent == 17
    ear.wait(17)
    frames = [item for item in ear.heard if item[1] == key(ROBOT, "source/frame")]
    played = [decode(data, Frame) for _, _, _, data in frames]
    assert all(time.time_ns() - HOUR_NS < item.header.trace[-1].sent_ns < time.time_ns() for item in played), "now"
    assert [untimed(item) for item in played] == [untimed(frame(seq, PERIOD_NS * seq)) for seq in range(8)]
    assert {what for _, _, what, _ in frames} == {encoding(Frame)}
    assert frames[-1][0] - frames[0][0] > 0.25, "they were 0.35 s apart"
    assert [decode(data, End).frames_sent for _, where, _, data in ear.heard if where.endswith("end")] == [8]


def test_a_part_of_it_under_another_name(contents: McapContents, link: LinkSettings, session: zenoh.Session) -> None:
    ear = Ear(session, "other")
    other = link.model_copy(update={"robot": "other"})
    playing = Playing(("source/frame", "source/end"), rate=10.0, start_s=0.1, end_s=0.25)
    assert play(contents, playing, other) == 5
    ear.wait(5)
    frames = [decode(data, Frame) for _, where, _, data in ear.heard if where == key("other", "source/frame")]
    assert [(item.header.robot, item.header.seq) for item in frames] == [("other", seq) for seq in range(2, 6)]
    (end,) = [decode(data, End) for _, where, _, data in ear.heard if where == key("other", "source/end")]
    assert (end.frames_sent, end.header.stamp_ns) == (4, 5 * PERIOD_NS)


def test_the_end_is_told_of_frames_that_were_recorded_alone(
    tmp_path: Path, link: LinkSettings, session: zenoh.Session
) -> None:
    path = tmp_path / "frames.mcap"
    write_recording(path, [[("source/frame", 0.01 * seq, frame(seq, PERIOD_NS * seq)) for seq in range(3)]])
    ear = Ear(session, ROBOT)
    play(open_mcap(path), Playing(("source/frame",), rate=10.0), link)
    ear.wait(4)
    assert [decode(data, End).frames_sent for _, where, _, data in ear.heard if where.endswith("end")] == [3]


def test_what_is_damaged_is_left_out(
    contents: McapContents, link: LinkSettings, session: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    damage_second_chunk(contents.path)
    ear = Ear(session, ROBOT)
    assert play(contents, Playing(("pose/pose",), rate=100), link) == 3
    ear.wait(3)
    assert "left out 1 of 2 chunks of messages" in caplog.text


def test_in_a_loop_until_it_is_stopped(contents: McapContents, link: LinkSettings, session: zenoh.Session) -> None:
    ear, stop = Ear(session, ROBOT), threading.Event()
    playing = Playing(("pose/pose", "bridge/health"), rate=10.0, loop=True)
    player = threading.Thread(target=play, args=(contents, playing, link, stop))
    player.start()
    try:
        ear.wait(17)
        alive = [str(reply.ok.key_expr) for reply in session.liveliness().get(alive_key(ROBOT, "*")) if reply.ok]
    finally:
        stop.set()
        player.join(LIMIT_S)
    assert not player.is_alive()
    assert alive == [alive_key(ROBOT, "pose")]
    seqs = [decode(data, Pose).header.seq for _, _, _, data in ear.heard]
    assert seqs[:17] == [*range(8), *range(8), 0]


def test_where_a_clock_was_set_it_goes_on_at_once_and_says_so(
    tmp_path: Path, link: LinkSettings, session: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    path, year_s = tmp_path / "set.mcap", 365 * 86400.0
    seconds = (0.0, 0.05, year_s, year_s + 0.3)
    write_recording(path, [[("source/frame", at, frame(seq, PERIOD_NS * seq)) for seq, at in enumerate(seconds)]])
    ear, stop = Ear(session, ROBOT), threading.Event()
    player = threading.Thread(target=play, args=(open_mcap(path), Playing(("source/frame",)), link, stop))
    player.start()
    try:
        ear.wait(5)
    finally:
        stop.set()
        player.join(LIMIT_S)
    frames_s = [at_s for at_s, where, _, _ in ear.heard if where == key(ROBOT, "source/frame")]
    assert frames_s[3] - frames_s[2] > 0.2, "what follows the gap keeps its pace"
    assert "a gap of 31536000 s in the recording is skipped" in caplog.text


def test_not_beside_the_stage_itself(contents: McapContents, link: LinkSettings, session: zenoh.Session) -> None:
    token = session.liveliness().declare_token(alive_key(ROBOT, "pose"))
    with pytest.raises(StageAliveError, match="pose of robot 'robot' is running; play under another name"):
        play(contents, Playing(tuple(contents.topics)), link)
    token.undeclare()


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        (5.0, None, "is 0.4 s long, but --from is 5 s$"),
        (0.3, 0.2, "is 0.4 s long, but --from is 0.3 s and --to 0.2 s$"),
    ],
)
def test_what_plays_nothing_is_refused(contents: McapContents, start: float, end: float | None, said: str) -> None:
    with pytest.raises(CommandError, match=rf"^nothing to play: {contents.path} {said}"):
        play_command(contents.path, start=start, end=end)


def test_a_recording_without_messages_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    McapWriter(path, PROFILE, "test").close()
    with pytest.raises(CommandError, match=rf"^nothing to play: {path} holds no messages$"):
        play_command(path)


def test_a_key_pauses_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pty.openpty()
    pace, stop, reached = Pace(1.0, print), threading.Event(), list[float]()
    with os.fdopen(theirs, "r") as terminal, os.fdopen(ours, "w") as keyboard:
        monkeypatch.setattr(sys, "stdin", terminal)
        with on_key(lambda pressed: pace.toggle() if pressed == " " else None) as there:
            assert there
            start_s = time.monotonic()
            pace.restart()
            keyboard.write(" ")
            keyboard.flush()
            end_s = start_s + LIMIT_S
            while not pace.paused:
                assert time.monotonic() < end_s
                time.sleep(0.01)
            waiting = threading.Thread(
                target=lambda: reached.append(time.monotonic()) if pace.wait(0.2, stop) else None
            )
            waiting.start()
            time.sleep(0.5)
            assert not reached, "the clock stands still"
            keyboard.write("x ")
            keyboard.flush()
            waiting.join(LIMIT_S)
    assert reached
    assert reached[0] - start_s > 0.6


def test_a_topic_of_a_later_version_is_left_out(
    contents: McapContents, link: LinkSettings, session: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    sent = play(contents, Playing(("pose/pose", "source/imu"), rate=10.0), link)
    assert sent == 8
    assert "source/imu is left out" in caplog.text
