"""Keyframes in their order: each is helped by what the frames before it told."""

import numpy as np
import pytest
from fusion_room import ROOM, THREE, look_at, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.segments.finder import find_segments
from spot3d.segments.keyframe_segments import KeyframeSegments
from spot3d.segments.settings import SegmentsSettings

MS = 1_000_000
CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
SETTINGS = SegmentsSettings()


def frame_at(ms: int, scale: float = 1.0) -> tuple[RgbdFrame, NDArray[np.uint8], NDArray[np.float64]]:
    """A frame of a camera that moves by 30 cm a second, its heat, and its pose; depth times `scale`."""
    pose = look_at((3e-4 * ms, -0.95, 0.7))
    found = view(pose, ROOM + THREE, np.random.default_rng(ms), CAMERA)
    return RgbdFrame(ms * MS, found.colour, scale * found.depth, 1.0, CAMERA), found.heat, pose


def torn(frame: RgbdFrame) -> RgbdFrame:
    """A gap through the object in the middle."""
    depth = frame.depth.copy()
    depth[:, 150:175] = 0
    return RgbdFrame(frame.stamp_ns, frame.colour, depth, 1.0, CAMERA)


def middle(found: FrameSegments) -> int:
    """Pixels of what the object in the middle is found to be, in the gap."""
    return int(np.count_nonzero(found.labels[90:130, 150:175]))


@pytest.mark.parametrize("away", [0.0, 20.0], ids=["near", "far"])
@pytest.mark.parametrize("factor", [1.0, 1.04])
def test_a_torn_keyframe_has_what_the_frames_before_saw(factor: float, away: float) -> None:
    """factor: depth is too short by that, as the pose stage finds out at last; away: metres from the world's origin."""
    finder = KeyframeSegments(SETTINGS)
    keyframes = []
    for ms in range(0, 400, 33):
        frame, heat, pose = frame_at(ms, 1 / factor)
        if ms == 330:
            frame = torn(frame)
        pose[0, 3] += away
        if finder.wants(frame.stamp_ns, pose):
            found = finder.find(frame, heat, pose, factor if ms == 330 else 1.0)
            keyframes += [] if found is None else [(ms, found)]
    assert [ms for ms, _ in keyframes] == [0, 330]
    whole, heat, _ = frame_at(330, 1 / factor)
    alone = find_segments(torn(whole).colour, torn(whole).depth_metres(), heat, CAMERA, SETTINGS)
    untorn = find_segments(whole.colour, whole.depth_metres(), heat, CAMERA, SETTINGS)
    helped = keyframes[1][1]
    assert (len(alone), len(untorn), len(helped)) == (4, 3, 3), "the gap divides an object"
    assert middle(alone) < 0.8 * middle(untorn)
    assert middle(helped) == pytest.approx(middle(untorn), rel=0.05)


def test_nothing_is_wanted_between_frames_that_are_remembered() -> None:
    finder, wanted = KeyframeSegments(SETTINGS), []
    for ms in range(0, 500, 20):
        frame, heat, pose = frame_at(ms)
        if finder.wants(frame.stamp_ns, pose):
            wanted.append(ms)
            finder.find(frame, heat, pose)
    assert wanted == [0, 100, 200, 300, 400]


def test_keyframes_alone_are_wanted_where_none_is_remembered() -> None:
    finder, wanted = KeyframeSegments(SETTINGS.model_copy(update={"recent_frames": 0})), []
    for ms in range(0, 700, 20):
        frame, heat, pose = frame_at(ms)
        if finder.wants(frame.stamp_ns, pose):
            wanted.append(ms)
            assert finder.find(frame, heat, pose) is not None
    assert wanted == [0, 300, 600]
    off = KeyframeSegments(SETTINGS.model_copy(update={"enabled": False}))
    assert not any(off.wants(ms * MS, np.eye(4)) for ms in range(0, 700, 20))


def test_another_world_begins_with_nothing_remembered() -> None:
    finder = KeyframeSegments(SETTINGS)
    for world in ("first", "second"):
        for ms in (0, 100, 200):
            frame, heat, pose = frame_at(ms)
            if finder.wants(frame.stamp_ns, pose, world):
                finder.find(frame, heat, pose)
        frame, heat, pose = frame_at(330)
        frame = torn(frame)
        assert finder.wants(frame.stamp_ns, pose, "third" if world == "second" else world)
        found = finder.find(frame, heat, pose)
        assert found is not None
        alone = find_segments(frame.colour, frame.depth_metres(), heat, CAMERA, SETTINGS)
        assert (len(alone), len(found)) == (4, 3 if world == "first" else 4)
