"""The pose stage amid a stream: what it says where it is lost, and where it goes on."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from spot3d.dataflow.conversion import frame_message
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.node import Received
from spot3d.dataflow.settings import LinkSettings
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.process import _Stage
from spot3d.pose.settings import PoseSettings
from spot3d.source.halving import halve
from spot3d.source.scene.scene import Scene
from spot3d_schemas import Frame, Header, Pose

S = 10**9
STEP_NS = S // 30


@dataclass
class NodeOfTest:
    """What the stage asks of its connection, without one."""

    link: LinkSettings
    stream: str | None = "kitchen"
    state: str = ""
    counters: Counters = field(default_factory=lambda: Counters("pose", 0.0))
    published: list[Pose] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def header(self, _: str, given: Received[Frame]) -> Header:
        return given.message.header

    def publish(self, _: str, message: Pose) -> bool:
        self.published.append(message)
        return True

    def measure_latency(self, _: Header) -> None:
        """Nobody asks."""

    def note(self, kind: str, text: str) -> None:
        self.notes.append(text)


def frames(count: int, start_ns: int, metres: float = 1.0) -> Iterator[Frame]:
    """A camera's frames of the built-in scene, from a stamp on; metres: by what depth is to be multiplied."""
    scene = Scene(frames=count)
    for index in range(count):
        frame = halve(halve(scene[index]))
        frame = replace(frame, depth_scale=metres * frame.depth_scale, T_world_camera=None)
        header = Header(robot="robot", seq=index, stamp_ns=start_ns + index * STEP_NS, frame_id="camera")
        yield frame_message(header, frame)


def answer(stage: _Stage, given: Iterator[Frame], recording: int = 0, begins: bool = False) -> None:
    for number, frame in enumerate(given):
        stage._answer(Received(frame, 0, recording, begins and number == 0))


@pytest.fixture
def node(tmp_path: Path) -> NodeOfTest:
    return NodeOfTest(LinkSettings(snapshot_folder=str(tmp_path)))


def test_a_clock_that_starts_again_amid_a_stream_begins_another_world(node: NodeOfTest) -> None:
    """A camera that is plugged in again counts from its new start; its program names the same stream."""
    stage = _Stage(node, PoseSettings())  # type: ignore[arg-type]
    answer(stage, frames(3, 1000 * S), begins=True)
    stage._keep()
    stage.snapshots.close()
    answer(stage, frames(3, 5 * S), recording=1)
    assert [pose.status for pose in node.published] == ["ok"] * 6
    assert len({pose.epoch for pose in node.published[:3]}) == 1
    assert len({pose.epoch for pose in node.published}) == 2
    np.testing.assert_allclose(node.published[3].T_world_camera, np.eye(4))


def test_a_stage_that_is_started_again_goes_on_in_its_world(node: NodeOfTest) -> None:
    before = _Stage(node, PoseSettings())  # type: ignore[arg-type]
    answer(before, frames(3, 1000 * S), begins=True)
    before._keep()
    before.snapshots.close()
    answer(_Stage(node, PoseSettings()), frames(3, 1001 * S), begins=True)  # type: ignore[arg-type]
    assert len({pose.epoch for pose in node.published}) == 1


def test_who_was_never_followed_is_not_sent_back(node: NodeOfTest) -> None:
    stage = _Stage(node, PoseSettings())  # type: ignore[arg-type]
    answer(stage, frames(40, 1000 * S, metres=1000.0), begins=True)
    assert "no frame has been tracked yet" in node.state
    assert "depth_scale" in node.state
    answer(stage, frames(1, 1010 * S))
    assert node.state == ""
    answer(stage, frames(40, 1011 * S, metres=1000.0))
    assert "move the camera back" in node.state


def test_a_world_whose_origin_is_too_far_is_told_once(node: NodeOfTest) -> None:
    """Poses in a map's grid, such as UTM: odometry does without them."""
    grid = np.eye(4)
    grid[:2, 3] = 4.5e5, 5.4e6
    given = (frame.model_copy(update={"T_world_camera": grid}) for frame in frames(3, 1000 * S))
    answer(_Stage(node, PoseSettings()), given, begins=True)  # type: ignore[arg-type]
    assert [text.split(":")[0] for text in node.notes] == [
        "the first given pose, at (4.5e+05, 5.4e+06, 0) m, is beyond the map's 2000 m from the origin"
    ]
    np.testing.assert_array_equal(node.published[0].T_world_camera, np.eye(4))


def test_intrinsics_of_another_image_size_are_told_with_what_is_lost(node: NodeOfTest) -> None:
    stage = _Stage(node, PoseSettings())  # type: ignore[arg-type]

    def wrong(metres: float) -> Iterator[Frame]:
        for frame in frames(40, 1000 * S, metres):
            taken = frame.intrinsics
            larger = taken.model_copy(update={"fx": 2 * taken.fx, "fy": 2 * taken.fy, "cx": 2 * taken.cx})
            yield frame.model_copy(update={"intrinsics": larger})

    answer(stage, frames(2, 900 * S), begins=True)
    assert node.notes == []
    answer(stage, wrong(1000.0))
    assert "intrinsics are those of images of this size" in node.state


def test_given_poses_that_jump_again_and_again_are_told_as_long_as_they_do(node: NodeOfTest) -> None:
    stage = _Stage(node, PoseSettings(provider="given"))  # type: ignore[arg-type]
    estimates = iter([PoseEstimate(np.eye(4), "ok", restarted=at in (1, 2, 5)) for at in range(360)])
    stage._begin()
    stage.tracker = SimpleNamespace(track=lambda _: next(estimates))
    states = []
    frame = next(frames(1, 0))
    for at in range(360):
        header = frame.header.model_copy(update={"stamp_ns": at * STEP_NS})
        stage._answer(Received(frame.model_copy(update={"header": header}), 0))
        states.append(node.state)
    assert states[1] == ""
    assert "the given poses jump away from what depth shows: are the given poses camera-to-world" in states[2]
    assert states[300] != ""
    assert states[303] == "", "ten seconds after the last but one"
    assert len(node.notes) == 3
    assert "camera-to-world" in node.notes[0]
