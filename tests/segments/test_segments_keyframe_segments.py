"""Keyframes in their order: each is helped by what the frames before it told."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import ROOM, THREE, Cuboid, View, look_at, standing, view
from numpy.typing import NDArray

from spot3d.calibration import NOMINAL, Calibration
from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.segments.finder import find_segments
from spot3d.segments.keyframe_segments import KeyframeSegments
from spot3d.segments.settings import SegmentsSettings

MS = 1_000_000
CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
SQUARE = Intrinsics(300.0, 300.0, 119.5, 119.5, 240, 240)
ONES = np.ones(CAMERA.shape, np.float32)
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
            found = finder.find(frame, heat, pose, Calibration(factor) if ms == 330 else NOMINAL)
            keyframes += [] if found is None else [(ms, found)]
    assert [ms for ms, _ in keyframes] == [0, 330]
    whole, heat, _ = frame_at(330, 1 / factor)
    alone = find_segments(torn(whole).colour, torn(whole).depth_metres(), heat, CAMERA, SETTINGS)
    untorn = find_segments(whole.colour, whole.depth_metres(), heat, CAMERA, SETTINGS)
    helped = keyframes[1][1]
    assert (len(alone), len(untorn), len(helped)) == (4, 3, 3), "the gap divides an object"
    assert middle(alone) < 0.8 * middle(untorn)
    assert middle(helped) == pytest.approx(middle(untorn), rel=0.05)


def test_what_bends_depth_is_taken_out_of_keyframes_and_of_what_is_remembered() -> None:
    known = Calibration(bend=((0.01, 0.02, -0.01, 0.0, 0.03, 0.0), (0.0, 0.0, 0.02, 0.02, 0.0, -0.03)) * 2)
    found = []
    for bends, by in ((False, NOMINAL), (True, known), (True, NOMINAL)):
        finder = KeyframeSegments(SETTINGS)
        for ms in (0, 230, 330):
            frame, heat, pose = frame_at(ms)
            if ms == 330:
                frame = torn(frame)
            if bends:
                frame = replace(frame, depth=(frame.depth_metres() / known.straightened(ONES)).astype(np.float32))
            assert finder.wants(frame.stamp_ns, pose)
            segments = finder.find(frame, heat, pose, by)
        assert segments is not None
        found.append(segments)
    straight, straightened, bent = found
    np.testing.assert_allclose(straightened.planes, straight.planes, atol=1e-4)
    assert np.abs(bent.planes[0] - straight.planes[0]).max() > 1e-3
    assert np.mean(straightened.labels != straight.labels) < 0.001


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


def test_the_first_frame_of_another_world_is_a_keyframe() -> None:
    finder = KeyframeSegments(SETTINGS.model_copy(update={"recent_frames": 0}))
    wanted = [finder.wants(ms * MS, np.eye(4), world) for ms, world in ((0, "a"), (100, "a"), (133, "b"), (166, "b"))]
    assert wanted == [True, False, True, False]


ALONE = SETTINGS.model_copy(update={"recent_frames": 0})
SCREEN = Cuboid((0.1, 0.4, 0.28), (0.5, 0.02, 0.3), colour=(30, 30, 35), heat=1.0)
MUG = standing(-0.3, 0.0, (0.09, 0.09, 0.1))


def next_found(
    finder: KeyframeSegments, seen: View, pose: NDArray[np.float64], second: int, camera: Intrinsics = CAMERA
) -> FrameSegments:
    """What is found in a keyframe that a camera sees so many seconds after the first; all of it is warm."""
    frame = RgbdFrame(second * 1000 * MS, seen.colour, seen.depth, 1.0, camera)
    assert finder.wants(frame.stamp_ns, pose)
    found = finder.find(frame, np.maximum(seen.heat, 60), pose)
    assert found is not None
    return found


def faces_up(found: FrameSegments, pose: NDArray[np.float64]) -> bool:
    """Whether the support that was found is level in the world."""
    return bool((pose[:3, :3] @ found.planes[0, :3])[2] > 0.99)


@pytest.mark.parametrize("looks_down", [-10, 0, 10])
def test_a_wall_that_a_run_begins_with_is_not_taken_for_what_things_stand_on(looks_down: float) -> None:
    """Not then, and not when a table is seen with the same wall, and a screen that stands as the wall does."""
    finder, rng = KeyframeSegments(ALONE), np.random.default_rng(0)
    pose = look_at((0, 0.4, 0.8), (0, 1.5, 0.8 - 1.1 * np.tan(np.radians(looks_down))))
    for second in range(6):
        found = next_found(finder, view(pose, ROOM[2:], rng, CAMERA), pose, second)
        assert abs(pose[:3, :3] @ found.planes[0, :3])[1] > 0.99, "there is nothing but the wall"
    pose = look_at((0, -0.95, 0.7))
    for second in range(10, 14):
        seen = view(pose, (*ROOM, SCREEN, MUG), rng, CAMERA)
        found = next_found(finder, seen, pose, second)
        assert faces_up(found, pose)
        for thing in (SCREEN, MUG):
            own = (seen.colour == thing.colour).all(-1)
            shares = [np.count_nonzero(own & mask) / np.count_nonzero(own | mask) for mask in masks(found)]
            assert max(shares) > 0.8


def masks(found: FrameSegments) -> list[NDArray[np.bool_]]:
    return [found.labels == number + 1 for number in range(len(found))]


def test_a_camera_that_rolls_for_long_after_it_began_upright_still_knows_what_is_up() -> None:
    """The side of the screen that faces the image's upper side is not learned as up, however often it is seen."""
    finder, rng, upright = KeyframeSegments(ALONE), np.random.default_rng(0), look_at((0, -0.95, 0.7))
    for second in range(30):
        seen, pose = view(upright, (*ROOM, SCREEN, MUG), rng, CAMERA), upright.copy()
        if second >= 6:
            seen = View(*(np.ascontiguousarray(image[::-1, ::-1]) for image in (seen.colour, seen.depth, seen.heat)))
            pose[:3, :2] *= -1
        assert faces_up(next_found(finder, seen, pose, second), pose)
    assert finder.side_up == "", "it is mounted as the settings say"


@pytest.mark.parametrize(("quarters", "side"), [(0, ""), (1, "right"), (2, "bottom"), (3, "left")])
def test_a_camera_that_is_mounted_otherwise_than_the_settings_say_is_found_out(quarters: int, side: str) -> None:
    finder, rng, quarter = KeyframeSegments(ALONE), np.random.default_rng(0), np.eye(4)
    quarter[:2, :2] = (0, 1), (-1, 0)
    for second in range(20):
        assert finder.side_up == ""
        upright = look_at((0.02 * second - 0.2, -0.95, 0.7))
        seen = view(upright, (*ROOM, *THREE), rng, SQUARE)
        turned = (np.ascontiguousarray(np.rot90(i, -quarters)) for i in (seen.colour, seen.depth, seen.heat))
        pose = upright @ np.linalg.matrix_power(quarter, quarters)
        next_found(finder, View(*turned), pose, second, SQUARE)
    assert finder.side_up == side


def test_what_was_up_in_another_world_is_forgotten() -> None:
    finder, (_, _, pose) = KeyframeSegments(SETTINGS), frame_at(0)
    for _ in range(5):
        finder._up_direction.learn(np.array((0.0, 0.0, 1.0)))
    finder.wants(0, pose)
    assert finder._up_direction.in_camera(pose) is not None
    finder.wants(33 * MS, pose, world="another")
    assert finder._up_direction.in_camera(pose) is None


def test_a_keyframe_is_filled_by_the_scale_of_depth_that_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    told, finder, (frame, heat, pose) = [], KeyframeSegments(SETTINGS), frame_at(0)

    def noted(recent: object, lattice: object, T: object, stamp_ns: int, depth_factor: float = 1.0) -> object:
        told.append((stamp_ns, depth_factor))
        return lattice

    monkeypatch.setattr("spot3d.segments.recent_depth.RecentDepth.filled", noted)
    assert finder.wants(frame.stamp_ns, pose)
    finder.find(frame, heat, pose, Calibration(1.04))
    assert told == [(0, 1.04)]
