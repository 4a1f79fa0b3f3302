"""What may be fused when: live at heat and pose, lossless when the segments have answered too."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.dataflow.conversion import segments_message
from spot3d.dataflow.join import Skipped
from spot3d.dataflow.node import Received
from spot3d.dataflow.settings import LinkSettings
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.inputs import Arrival, LiveInputs, LosslessInputs, inputs_of
from spot3d_schemas import CameraIntrinsics, Header, Heat, Pose

CAMERA = Intrinsics(2.0, 2.0, 0.5, 0.5, 2, 2)
FOUND = FrameSegments(
    np.ones((2, 2), np.uint8), np.ones(1, np.float32), np.zeros((0, 4)), np.full(1, -1, np.int8), CAMERA
)
LIVE = LinkSettings(delivery="live")


def lossless(in_flight: int) -> LinkSettings:
    return LinkSettings(delivery="lossless", in_flight=in_flight)


def header(stamp: int) -> Header:
    return Header(robot="r", seq=0, stamp_ns=stamp, frame_id="camera")


def heat(stamp: int) -> Heat:
    return Heat(
        header=header(stamp),
        intrinsics=CameraIntrinsics(fx=2.0, fy=2.0, cx=0.5, cy=0.5, width=2, height=2),
        depth_scale=1.0,
        colour=np.zeros((2, 2, 3), np.uint8),
        depth=np.ones((2, 2), np.float32),
        heat=np.zeros((2, 2), np.uint8),
        accepted=0,
        masked=0,
        rejected=0,
    )


def told(arrival: Arrival) -> list[str]:
    """`3` a frame without segments, `3s` one with, `s3` segments that come late, `-3` a skipped one; then drops."""
    out = []
    for ready in arrival.frames:
        if isinstance(ready, Skipped):
            out.append(f"-{ready.stamp_ns} {ready.reason}")
            continue
        stamp = ready.heat.message.header.stamp_ns
        assert ready.pose.message.header.stamp_ns == stamp
        if ready.segments is not None:
            assert ready.segments.message.header.stamp_ns == stamp
        out.append(f"{stamp}{'s' if ready.segments is not None else ''}")
    if arrival.late is not None:
        out.append(f"s{arrival.late.message.header.stamp_ns}")
    return out + arrival.drops


def feed(inputs: LiveInputs | LosslessInputs, items: str) -> list[str]:
    """Feed H (heat), P (pose), K (a keyframe's segments) and N (no keyframe) with their stamps."""
    out = []
    for item in items.split():
        kind, stamp = item[0], int(item[1:])
        if kind == "H":
            out += told(inputs.add_heat(Received(heat(stamp), 0)))
        elif kind == "P":
            pose = Pose(header=header(stamp), T_world_camera=np.eye(4), status="ok", reason="", provider="kiss")
            out += told(inputs.add_pose(Received(pose, 0)))
        else:
            message = segments_message(header(stamp), FOUND if kind == "K" else None)
            out += told(inputs.add_segments(Received(message, 0)))
    return out


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ("P1 H1 K1 P2 H2 N2", ["1", "s1", "2"]),
        ("P1 H1 P2 H2 K1", ["1", "2", "s1"]),
        ("P1 H1 P2 K2 H2", ["1", "2s"]),  # the segments of 2 have overtaken its heat
        ("P1 H1 K2 P3 H3", ["1", "3", "segments without their frame"]),
        ("P1 P2 H2", ["-1 no heat", "2"]),
        ("P1 H1 N2 N3", ["1"]),
        ("K1 P1 H1", ["1s"]),
    ],
)
def test_live(items: str, expected: list[str]) -> None:
    assert feed(LiveInputs(LIVE), items) == expected


def test_live_poses_may_come_half_a_second_late() -> None:
    heats = " ".join(f"H{stamp}" for stamp in range(1, 17))
    assert feed(LiveInputs(LIVE), f"{heats} P1 H17 P2 H18 H19") == ["1", "2", "-3 no pose"]


def test_live_counts_the_frames_without_a_word_of_the_segments_stage() -> None:
    inputs = LiveInputs(LIVE)
    feed(inputs, "P1 H1 P2 H2 P3 H3")
    assert inputs.alone == 3
    feed(inputs, "N3 P4 H4")
    assert inputs.alone == 1
    inputs.clear()
    assert inputs.alone == 0, "another stream"


@pytest.mark.parametrize(
    ("items", "unanswered"),
    [
        ("", False),
        ("P1", False),  # no frame yet
        ("P1 H1", True),
        ("P1 H1 P2 H2 K1", True),
        ("P1 H1 P2 H2 K1 N2", False),
        ("P1 H1 P2 H2 K2", False),  # 1 was left out: the newest wins
        ("P1 H1 N2 P2 H2", False),
        ("P1 H1 K2", False),  # whoever looks at frames without heat is ahead
    ],
)
def test_live_knows_whether_segments_may_still_come(items: str, unanswered: bool) -> None:
    inputs = LiveInputs(LIVE)
    feed(inputs, items)
    assert inputs.unanswered == unanswered
    inputs.clear()
    assert not inputs.unanswered


def test_live_keeps_few_early_segments() -> None:
    early = " ".join(f"K{stamp}" for stamp in range(100, 120))
    assert feed(LiveInputs(LIVE), early) == ["segments without their frame"] * 4


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ("P1 H1 K1 P2 H2 N2", ["1s", "2s"]),
        ("P1 H1 P2 H2 K1 K2", ["1s", "2s"]),
        ("K1 P1 H1", ["1s"]),
        ("P1 H1 P2 H2 K2", ["1", "2s", "no segments"]),  # nobody answers 1 any more: it goes first
        ("H1 P2 H2 K2", ["-1 no pose", "2s"]),
        ("P1 H1 P2 H2 P3 H3", ["1", "no segments"]),  # two wait at most
        ("P1 H1 H2 P3", []),  # that 2 has no pose waits for 1
        ("P1 H1 H2 P3 K1", ["1s", "-2 no pose"]),
        ("P1 H1 H2 P3 H3 H4 P5 K3", ["1", "-2 no pose", "3s", "-4 no pose", "no segments"]),
    ],
)
def test_lossless(items: str, expected: list[str]) -> None:
    assert feed(LosslessInputs(lossless(1)), items) == expected


def test_what_waits_at_the_end_is_not_lost() -> None:
    inputs = LosslessInputs(lossless(4))
    assert feed(inputs, "P1 H1 P2 H2") == []
    assert told(Arrival(inputs.rest())) == ["1", "2"]
    assert inputs.rest() == []
    assert feed(inputs, "P3 H3 H4 P5 H5") == []
    assert told(Arrival(inputs.rest())) == ["3", "-4 no pose", "5"]
    assert feed(inputs, "P6 H6 K6 H7 H8") == ["6s"]
    assert told(Arrival(inputs.rest())) == ["-7 no pose", "-8 no pose"]


def test_live_frames_that_wait_at_the_end_are_told_with_what_they_lack() -> None:
    inputs = LiveInputs(LIVE)
    assert feed(inputs, "P1 H1 H2 H3") == ["1"]
    assert told(Arrival(inputs.rest())) == ["-2 no pose", "-3 no pose"]
    assert inputs.rest() == []


def test_the_delivery_decides() -> None:
    assert isinstance(inputs_of(LinkSettings(delivery="live")), LiveInputs)
    assert isinstance(inputs_of(LinkSettings(delivery="lossless")), LosslessInputs)
