"""The segments stage amid a stream: what it says of a camera that is mounted with another side up."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, THREE, look_at, view
from schemas_samples import SAMPLES

from spot3d.dataflow.conversion import intrinsics_message
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.join import NO_POSE
from spot3d.dataflow.node import Received
from spot3d.dataflow.process_use import ProcessUse
from spot3d.dataflow.settings import LinkSettings
from spot3d.segments.process import _Stage
from spot3d.segments.settings import SegmentsSettings
from spot3d_schemas import Header, Heat, Pose, Segments

S = 10**9
SETTINGS = SegmentsSettings(recent_frames=0)


@dataclass
class NodeOfTest:
    """What the stage asks of its connection, without one."""

    link: LinkSettings = field(default_factory=LinkSettings)
    state: str = ""
    counters: Counters = field(default_factory=lambda: Counters("segments", 0.0))
    published: list[Segments] = field(default_factory=list)
    notes: list[tuple[str, str]] = field(default_factory=list)

    def header(self, _: str, given: Received[Heat]) -> Header:
        return given.message.header

    def publish(self, _: str, message: Segments) -> bool:
        self.published.append(message)
        return True

    def measure_latency(self, _: Header) -> None:
        """Nobody asks."""

    def note(self, kind: str, text: str) -> None:
        self.notes.append((kind, text))


def give(stage: _Stage, count: int, recording: int = 0) -> None:
    """So many keyframes of a table, by a camera that hangs upside down."""
    for number in range(count):
        pose = look_at((0.01 * number, -0.95, 0.7))
        seen = view(pose, ROOM + THREE, np.random.default_rng(number))
        upright = seen.colour, seen.depth, np.maximum(seen.heat, 60)
        colour, depth, heat = (np.ascontiguousarray(image[::-1, ::-1]) for image in upright)
        pose[:3, :2] *= -1
        header = Header(robot="robot", seq=number, stamp_ns=(1 + number) * S, frame_id="camera")
        sent = Heat(
            header=header,
            intrinsics=intrinsics_message(CAMERA),
            depth_scale=1.0,
            colour=colour,
            depth=depth,
            heat=heat,
            accepted=0,
            masked=0,
            rejected=0,
        )
        begins = recording > 0 and number == 0
        stage.take_heat(Received(sent, 0, recording, begins))
        given = Pose(header=header, status="ok", reason="", provider="given", T_world_camera=pose)
        stage.take_pose(Received(given, 0, recording))


def test_it_is_told_once_that_the_camera_hangs_upside_down() -> None:
    """In the log and among the events, and in the state as long as that recording goes on."""
    node = NodeOfTest()
    stage = _Stage(node, SETTINGS)  # type: ignore[arg-type]
    for recording in range(2):
        give(stage, 19, recording)
    assert (node.notes, node.state) == ([], ""), "of another recording nothing is known"
    give(stage, 25, recording=2)
    assert 'segments.image_up = "bottom"' in node.state
    assert node.notes == [("bottom side seems up", node.state)]
    give(stage, 1, recording=3)
    assert node.state == ""
    assert len(node.published) == 19 + 19 + 25 + 1
    assert all(answer.keyframe for answer in node.published)


def test_where_the_settings_say_so_nothing_is_told() -> None:
    node = NodeOfTest()
    give(_Stage(node, SETTINGS.model_copy(update={"image_up": "bottom"})), 25)  # type: ignore[arg-type]
    assert (node.notes, node.state) == ([], "")


@pytest.mark.parametrize(
    ("delivery", "in_flight", "dropped"), [("live", 1, 2), ("live", 64, 2), ("lossless", 1, 2), ("lossless", 64, 0)]
)
def test_how_many_heats_wait_for_their_poses(delivery: str, in_flight: int, dropped: int) -> None:
    """What a lossless run may have on its way does not go for a live one, whose images must not grow old."""
    node, heat = NodeOfTest(LinkSettings(delivery=delivery, in_flight=in_flight)), SAMPLES["Heat"]
    stage = _Stage(node, SETTINGS)
    for number in range(18):
        header = heat.header.model_copy(update={"stamp_ns": 1 + number})
        stage.take_heat(Received(heat.model_copy(update={"header": header}), 0))
    told = node.counters.health(heat.header, 1.0, ProcessUse(cpu_s=0.0, rss_bytes=1, threads=1))
    assert told.drops.get(NO_POSE, 0) == dropped
