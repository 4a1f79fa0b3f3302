"""Holes in a keyframe's depth are filled by what frames just before saw there, and by nothing else."""

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, THREE, Cuboid, look_at, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.geometry.downsampling import LatticeFrame
from spot3d.segments.recent_depth import RecentDepth, _Seen, _seen_from
from spot3d.segments.settings import SegmentsSettings

MS = 1_000_000
SETTINGS = SegmentsSettings(lattice_width=160)
BEFORE, NOW = look_at((-0.03, -0.95, 0.7)), look_at((0.0, -0.95, 0.71))
HOLE = np.s_[52:76, 60:100]
"""Of an object, and of the table around it."""


def seen(pose: NDArray[np.float64], things: tuple[Cuboid, ...] = THREE, seed: int = 0) -> LatticeFrame:
    found = view(pose, ROOM + things, np.random.default_rng(seed))
    return LatticeFrame(found.colour, found.depth, found.heat, CAMERA)


def torn(frame: LatticeFrame, hole: tuple[slice, slice] = HOLE) -> LatticeFrame:
    depth, heat = frame.depth.copy(), frame.heat.copy()
    depth[hole], heat[hole] = 0, 0
    return LatticeFrame(frame.colour, depth, heat, CAMERA)


def remembered(*frames: tuple[int, LatticeFrame, NDArray[np.float64]], count: int = 3) -> RecentDepth:
    recent = RecentDepth(SETTINGS.model_copy(update={"recent_frames": count}))
    for ms, frame, pose in frames:
        recent.remember(rgbd(ms, frame), frame.heat, pose)
    return recent


def rgbd(ms: int, frame: LatticeFrame) -> RgbdFrame:
    return RgbdFrame(ms * MS, frame.colour, frame.depth, 1.0, frame.camera)


def test_a_hole_has_the_depth_and_heat_that_were_seen_there_from_elsewhere() -> None:
    whole = seen(NOW, seed=1)
    filled = remembered((0, seen(BEFORE), BEFORE)).filled(torn(whole), NOW, 100 * MS)
    error = np.abs(filled.depth - whole.depth)[HOLE]
    assert np.mean(filled.depth[HOLE] > 0) > 0.98
    assert np.median(error) < 0.004, "noise of both, and half a pixel of a slanted surface"
    assert np.mean(error < 0.02) > 0.95, "all but edges"
    assert np.mean(np.abs(filled.heat.astype(int) - whole.heat)[HOLE] < 10) > 0.9


def test_what_was_measured_stays() -> None:
    frame = torn(seen(NOW, seed=1))
    filled = remembered((0, seen(BEFORE), BEFORE)).filled(frame, NOW, 100 * MS)
    measured = frame.depth > 0
    np.testing.assert_array_equal(filled.depth[measured], frame.depth[measured])
    np.testing.assert_array_equal(filled.heat[measured], frame.heat[measured])
    np.testing.assert_array_equal(filled.colour, frame.colour)


@pytest.mark.parametrize("along", [-0.01, 0.01])
def test_a_pose_that_is_a_centimetre_off_leaves_no_step(along: float) -> None:
    wrong = BEFORE.copy()
    wrong[:3, 3] += along * BEFORE[:3, 2]
    whole = seen(NOW, seed=1)
    filled = remembered((0, seen(BEFORE), wrong)).filled(torn(whole), NOW, 100 * MS)
    both = (filled.depth > 0)[HOLE]
    assert np.median(np.abs(filled.depth - whole.depth)[HOLE][both]) < 0.005
    assert both.mean() > 0.9


def test_a_pose_that_is_far_off_fills_nothing() -> None:
    wrong = BEFORE.copy()
    wrong[:3, 3] += 0.1 * BEFORE[:3, 2]
    frame = torn(seen(NOW, seed=1))
    filled = remembered((0, seen(BEFORE), wrong)).filled(frame, NOW, 100 * MS)
    assert np.mean(filled.depth[HOLE] > 0) < 0.02


def test_depth_of_another_scale_than_the_poses_fills_as_well() -> None:
    """It is 0.8 times what it should be, and the camera has come 30 cm nearer."""
    back, small = NOW.copy(), np.float32(0.8)
    back[:3, 3] -= 0.3 * NOW[:3, 2]
    far, near = seen(back), seen(NOW, seed=1)
    whole = LatticeFrame(near.colour, small * near.depth, near.heat, CAMERA)
    recent = remembered((0, LatticeFrame(far.colour, small * far.depth, far.heat, CAMERA), back))
    filled = recent.filled(torn(whole), NOW, 100 * MS, depth_factor=1.25)
    assert np.mean(filled.depth[HOLE] > 0) > 0.9
    assert np.median(np.abs(filled.depth - whole.depth)[HOLE]) < 0.005


def test_some_pixels_that_agree_are_chance() -> None:
    frame = seen(NOW, seed=1)
    kept = np.zeros_like(frame.depth)
    kept[60:65, 20:25] = frame.depth[60:65, 20:25]
    few = LatticeFrame(frame.colour, kept, frame.heat, CAMERA)
    filled = remembered((0, seen(BEFORE), BEFORE)).filled(few, NOW, 100 * MS)
    np.testing.assert_array_equal(filled.depth, kept)


def test_what_is_nearer_hides_what_is_behind_it_from_elsewhere() -> None:
    """From 10 cm further left what is 0.5 m away lies 30 pixels further right, and what is 2 m away 7."""
    depth = np.full(CAMERA.shape, 2.0, np.float32)
    depth[:, 20:25] = 0.5
    aside = np.eye(4)
    aside[0, 3] = 0.1
    found, _ = _seen_from(CAMERA, aside, _Seen(0, depth, np.zeros(CAMERA.shape, np.uint8), CAMERA, np.eye(4)))
    assert (found[:, 50:55] == 0.5).all()


def test_what_came_nearer_since_is_not_filled_with_what_was_behind_it() -> None:
    hand = Cuboid((0.0, -0.3, 0.3), (0.4, 0.1, 0.3), heat=1.0)
    frame = torn(seen(NOW, (*THREE, hand), seed=1), np.s_[50:70, 70:90])
    assert np.median(frame.depth[45:50, 70:90]) < 0.8, "the hole is in the hand"
    filled = remembered((0, seen(BEFORE), BEFORE)).filled(frame, NOW, 100 * MS)
    assert np.mean(filled.depth[50:70, 70:90] > 0) < 0.1


def test_the_last_frame_comes_first_and_what_it_lacks_comes_from_those_before() -> None:
    whole, left = seen(NOW, seed=1), np.s_[HOLE[0], 50:80]
    recent = remembered((0, seen(BEFORE), BEFORE), (100, torn(seen(NOW, seed=2), left), NOW))
    filled = recent.filled(torn(whole), NOW, 200 * MS)
    assert (filled.depth[HOLE] > 0).all()
    only_last = remembered((100, torn(seen(NOW, seed=2), left), NOW)).filled(torn(whole), NOW, 200 * MS)
    # Its rim gets a pixel of what is beside it.
    assert (only_last.depth[HOLE][2:, :18] == 0).all()
    np.testing.assert_array_equal(filled.depth[HOLE][:, 22:], only_last.depth[HOLE][:, 22:])


@pytest.mark.parametrize("ms", [0, -100, 1500])
def test_frames_of_another_time_fill_nothing(ms: int) -> None:
    frame = torn(seen(NOW))
    filled = remembered((0, seen(BEFORE), BEFORE)).filled(frame, NOW, ms * MS)
    np.testing.assert_array_equal(filled.depth, frame.depth)


def test_a_few_frames_are_remembered_some_time_apart() -> None:
    recent = remembered(count=2)
    assert recent.wants(0)
    for ms in (0, 33, 66, 100, 133, 200):
        if recent.wants(ms * MS):
            recent.remember(rgbd(ms, seen(BEFORE)), seen(BEFORE).heat, BEFORE)
    assert [item.stamp_ns // MS for item in recent._seen] == [100, 200]
    assert not recent.wants(210 * MS)
    assert recent.wants(0), "time went back: another recording"
    assert not remembered(count=0).wants(0)


def test_what_is_remembered_does_not_change_with_the_callers_images() -> None:
    frame, pose = seen(BEFORE), BEFORE.copy()
    recent = remembered((0, frame, pose))
    expected = recent.filled(torn(seen(NOW, seed=1)), NOW, 100 * MS).depth
    frame.depth[:] = 0
    frame.heat[:] = 0
    pose[:] = 0
    np.testing.assert_array_equal(recent.filled(torn(seen(NOW, seed=1)), NOW, 100 * MS).depth, expected)


def test_of_a_large_frame_so_many_pixels_are_kept_as_the_lattice_has() -> None:
    large = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
    found = view(BEFORE, ROOM + THREE, np.random.default_rng(0), large)
    recent = remembered((0, LatticeFrame(found.colour, found.depth, found.heat, large), BEFORE))
    assert recent._seen[0].depth.shape == (120, 160)
    whole = seen(NOW, seed=1)
    filled = recent.filled(torn(whole), NOW, 100 * MS)
    assert np.median(np.abs(filled.depth - whole.depth)[HOLE]) < 0.004


def test_another_camera_s_frame_fills_as_well() -> None:
    narrow = CAMERA.halved()
    found = view(BEFORE, ROOM + THREE, np.random.default_rng(0), narrow)
    recent = remembered((0, LatticeFrame(found.colour, found.depth, found.heat, narrow), BEFORE))
    whole = seen(NOW, seed=1)
    filled = recent.filled(torn(whole), NOW, 100 * MS)
    covered = filled.depth[HOLE] > 0
    assert covered.mean() > 0.6, "four pixels of each, which then lie two apart"
    assert np.median(np.abs(filled.depth - whole.depth)[HOLE][covered]) < 0.01
