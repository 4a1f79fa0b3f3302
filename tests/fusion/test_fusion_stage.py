"""Which frames fusion's stage fuses, and into which map."""

import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import zenoh

from spot3d.camera import Intrinsics
from spot3d.dataflow.alive import Alive
from spot3d.dataflow.conversion import segments_message
from spot3d.dataflow.join import NO_HEAT, NO_POSE, Skipped
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.process_use import ProcessUse
from spot3d.dataflow.settings import LinkSettings
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.inputs import Ready
from spot3d.fusion.map_answers import MapAnswers
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.snapshot import keep
from spot3d.fusion.snapshot_keeper import SnapshotKeeper
from spot3d.fusion.stage import FAILED, LOST, OUTPUTS, QUERIES, Stage
from spot3d.fusion.updates import Updates
from spot3d.fusion.worlds import World, why_refused
from spot3d_schemas import CameraIntrinsics, End, Header, Heat, Message, Pose

S = 10**9


class OffLine(Node):
    """A node that nobody hears."""

    def publish(self, topic: str, message: Message, jpeg_quality: int | None = None) -> bool:
        """As if it had gone out."""
        return True

    def reply(self, query: zenoh.Query, topic: str, message: Message) -> None:
        """As if it had been answered."""


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    """A stage that is not on line."""
    link = LinkSettings(snapshot_folder=str(tmp_path))
    node = OffLine("fusion", link, threading.Event(), outputs=OUTPUTS, queries=QUERIES)
    node.alive = Alive()
    keeper = SnapshotKeeper(node)
    with closing(Updates(node, keeper)) as updates, closing(MapAnswers(node)) as answers:
        yield Stage(node, Fusion(FusionSettings()), keeper, updates, answers, None)


def frame(stamp_ns: int, status: str = "ok", epoch: str | None = None, recording: int = 0, x: float = 0.0) -> Ready:
    """A wall a metre away, from x metres along it."""
    shape, camera = (60, 80), CameraIntrinsics(fx=70.0, fy=70.0, cx=39.5, cy=29.5, width=80, height=60)
    heat = Heat(
        header=Header(robot="robot", seq=0, stamp_ns=stamp_ns, frame_id="camera"),
        intrinsics=camera,
        depth_scale=0.001,
        colour=np.zeros((*shape, 3), np.uint8),
        depth=np.full(shape, 1000, np.uint16),
        heat=np.zeros(shape, np.uint8),
        accepted=0,
        masked=0,
        rejected=0,
    )
    T = np.eye(4)
    T[0, 3] = x
    pose = Pose(header=heat.header, T_world_camera=T, status=status, reason="", provider="given", epoch=epoch)
    return Ready(Received(heat, 0, recording), Received(pose, 0, recording), None)


def drops(stage: Stage) -> dict[str, int]:
    """What the stage has dropped, by reason."""
    header = Header(robot="robot", seq=0, stamp_ns=1, frame_id="camera")
    return dict(stage.node.counters.health(header, 1.0, ProcessUse(cpu_s=0.0, rss_bytes=1, threads=1)).drops)


@pytest.mark.parametrize(("status", "reason"), [("lost", LOST), ("ok", FAILED)])
def test_frames_that_are_not_fused_are_told_with_the_drops(stage: Stage, status: str, reason: str) -> None:
    stage.fusion.heatmap.arrays = None  # type: ignore[assignment]  # so that fusing fails
    stage._fuse(frame(1, status))
    assert drops(stage) == {reason: 1}


@pytest.mark.parametrize(
    ("reasons", "said"),
    [
        ((NO_POSE,) * 59, ""),
        (
            (NO_POSE,) * 60,
            "no frame was fused of the last 60 (60 no pose): check that the pose stage is running; a pose",
        ),
        ((NO_POSE, *(NO_HEAT,) * 59), "(59 no heat, 1 no pose): check that the pose stage is running"),
        ((NO_HEAT,) * 61, "of the last 61 (61 no heat): check that the proposals and heatmap stages are running"),
        ((FAILED,) * 60, "of the last 60 (60 error)"),
        ((LOST,) * 99, ""),
    ],
)
def test_the_state_says_why_nothing_is_fused(stage: Stage, reasons: tuple[str, ...], said: str) -> None:
    stage._account_for([Skipped(stamp, reason) for stamp, reason in enumerate(reasons)])
    assert said in stage.node.state if said else not stage.node.state
    stage._fuse(frame(S))
    assert not stage.node.state


def test_the_state_says_which_poses_are_refused(stage: Stage) -> None:
    stage._fuse(frame(S))
    for number in range(2, 62):
        stage._fuse(frame(S + number, x=1000))
    assert "60 implausible pose): the pose at (1e+03, 0, 0) m is not used: its speed is above" in stage.node.state
    stage._begin_stream("another")
    assert not stage.node.state


def test_an_unnamed_recording_begins_anew_though_its_first_frame_has_no_pose(stage: Stage) -> None:
    for stamp_s in (100, 101, 102):
        stage._fuse(frame(stamp_s * S))
    first = stage.epoch
    stage._fuse(frame(1 * S, "lost", recording=1))
    for stamp_s in (2, 3):
        stage._fuse(frame(stamp_s * S, recording=1, x=0.1))
    assert drops(stage) == {LOST: 1}
    assert stage.fusion.frame_count == 2
    assert stage.epoch != first


def test_images_of_frames_that_are_no_keyframes_are_not_kept(stage: Stage) -> None:
    """With the paper's preset none is one, and sixty VGA images took 129 MB."""
    ready = frame(1 * S)
    answer = Received(segments_message(ready.heat.message.header, None), 0)
    stage._fuse(ready)
    stage._fuse(frame(2 * S))
    stage._take_segments(answer)
    found = FrameSegments(
        np.zeros((60, 80), np.uint8),
        np.zeros(0, np.float32),
        np.zeros((0, 4)),
        np.zeros(0, np.int8),
        Intrinsics(**ready.heat.message.intrinsics.model_dump()),
    )
    assert not stage.fusion.observe(found, 1 * S)
    assert stage.fusion.observe(found, 2 * S), "no answer yet"
    stage._fuse(replace(frame(3 * S), segments=Received(segments_message(frame(3 * S).heat.message.header, None), 0)))
    assert not stage.fusion.observe(found, 3 * S)


def test_poses_that_name_another_world_begin_another_map(stage: Stage) -> None:
    for stamp_s, epoch in ((1, "a"), (2, "a"), (3, "b"), (4, "a"), (5, "b")):
        stage._fuse(frame(stamp_s * S, epoch=epoch))
    assert drops(stage) == {"pose of an earlier epoch": 1}
    assert stage.fusion.frame_count == 2


def test_a_map_that_was_reset_does_not_come_back_with_a_restart(stage: Stage) -> None:
    stage._begin_stream("stream")
    stage._fuse(frame(1 * S))
    stage.keeper.write(keep(stage.fusion, replace(stage._account(), stream="stream")), last=True)
    assert SnapshotKeeper(stage.node).begin(Fusion(FusionSettings()), "stream") is not None
    stage._answer_reset(SimpleNamespace(payload=None))
    stage.updates.close()
    stage.keep_last()
    assert SnapshotKeeper(stage.node).begin(Fusion(FusionSettings()), "stream") is None


def test_a_map_whose_snapshot_could_not_be_written_is_kept_at_the_end(stage: Stage, tmp_path: Path) -> None:
    stage._fuse(frame(1 * S))
    in_the_way = tmp_path / "robot"
    in_the_way.touch()  # as a disk that is full for a while
    stage.keeper.write(keep(stage.fusion, stage._account()), last=True)
    in_the_way.unlink()
    stage.updates.close()
    stage.keep_last()
    assert [path.name for path in in_the_way.iterdir()] == ["fusion.snapshot"]
    (in_the_way / "fusion.snapshot").unlink()
    stage.keep_last()
    assert list(in_the_way.iterdir()) == [], "what is kept is not kept again"


def played_to_its_end(stage: Stage) -> None:
    """Two frames of a live stream, and its end; the segments stage has said nothing yet."""
    for stamp_s in (1, 2):
        ready = frame(stamp_s * S)
        stage._take(stage.inputs.add_pose, ready.pose)
        stage._take(stage.inputs.add_heat, ready.heat)
    header = Header(robot="robot", seq=0, stamp_ns=2 * S, frame_id="camera")
    stage._ended(Received(End(header=header, frames_sent=2), 0))
    stage._complete_if_due()
    assert stage.ledger.fused == 2


def test_a_live_stream_that_has_ended_waits_for_the_segments_of_its_frames(stage: Stage) -> None:
    stage.node.alive.note("segments", True)
    played_to_its_end(stage)
    for stamp_s, complete in ((1, False), (2, True)):
        assert not stage.ledger.complete
        header = Header(robot="robot", seq=0, stamp_ns=stamp_s * S, frame_id="camera")
        stage._take_segments(Received(segments_message(header, None), 0))
        stage._complete_if_due()
        assert stage.ledger.complete == complete


def test_a_live_stream_that_has_ended_waits_for_no_segments_stage_that_is_gone(stage: Stage) -> None:
    stage.node.alive.note("segments", True)
    played_to_its_end(stage)
    assert not stage.ledger.complete
    stage.node.alive.note("segments", False)
    stage._complete_if_due()
    assert stage.ledger.complete


def test_a_world_that_is_forgotten_may_go_on_and_one_that_is_left_may_not() -> None:
    world, here = World(3.0), np.eye(4)
    far = np.eye(4)
    far[0, 3] = 100.0
    world.follow("a", here, S)
    assert world.judge("a", far, 2 * S) == "implausible pose"
    world.forget()
    assert world.judge("a", far, 2 * S) == "same"
    world.follow("a", far, 2 * S)
    assert world.judge("b", here, 3 * S) == "begins"
    world.leave()
    assert world.judge("b", here, 3 * S) == "same"
    assert world.judge("a", far, 3 * S) == "pose of an earlier epoch"


def test_a_place_that_the_map_does_not_reach_is_told_from_one_that_is_reached_too_soon() -> None:
    """Poses of a survey's grid lie thousands of kilometres from its origin, from the first one on."""
    world, here, soon, survey = World(3.0), np.eye(4), np.eye(4), np.eye(4)
    soon[0, 3], survey[:2, 3] = 100.0, (4.5e5, 5.4e6)
    assert world.judge("a", survey, S) == "pose too far from the origin"
    world.follow("a", here, S)
    assert world.judge("a", survey, 2 * S) == "pose too far from the origin"
    assert "(4.5e+05, 5.4e+06, 0) m is not used: the map extends to 2000 m" in why_refused(
        "pose too far from the origin", survey
    )
    assert "such as the first pose" in why_refused("pose too far from the origin", survey)
    assert why_refused(world.judge("a", soon, 2 * S), soon).endswith(
        "its speed is above fusion.speed_max; check the poses' unit and timestamps"
    )
    assert why_refused(world.judge("a", here, 2 * S), here) == ""
