"""Keyframes find the frames that were fused, and are bounded in number."""

import tracemalloc
from dataclasses import replace

import numpy as np
from fusion_room import CAMERA, COARSE, ROOM, THREE, orbit, view

from spot3d.camera_pose import CameraPose
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.objects.keyframes import without_spill
from spot3d.geometry.downsampling import to_lattice

POSES = orbit(4)
BLANK = np.zeros((*CAMERA.shape, 3), np.uint8), np.zeros(CAMERA.shape, np.float32), np.zeros(CAMERA.shape, np.uint8)
"""Colour, depth and heat of a frame that sees nothing."""


def fused(fusion: Fusion, count: int) -> None:
    """Frames with stamps 0, 1, 2, ..."""
    for stamp, pose in enumerate(POSES[:count]):
        seen = view(pose, ROOM + THREE)
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose), stamp)


def segments(label: int = 1) -> FrameSegments:
    labels = np.zeros(CAMERA.shape, np.uint8)
    labels[40:60, 40:60] = label
    return FrameSegments(
        labels,
        np.full(label, 0.5, np.float32),
        np.array([[0.0, -1.0, 0.0, 0.5]]),
        np.zeros(label, np.int8),
        CAMERA,
    )


def test_a_keyframe_is_what_was_fused_with_what_was_found() -> None:
    fusion = Fusion(COARSE.model_copy(update={"lattice_width": 80}))
    fused(fusion, 3)
    assert fusion.observe(segments(), 1)
    (keyframe,) = fusion.consensus.take_waiting()
    seen = view(POSES[1], ROOM + THREE)
    lattice = to_lattice(seen.colour, seen.depth, seen.heat, CAMERA, 80)
    np.testing.assert_array_equal(keyframe.depth, lattice.depth)
    assert keyframe.camera == lattice.camera
    assert keyframe.labels.shape == lattice.depth.shape
    assert 50 < np.count_nonzero(keyframe.labels[20:30, 20:30]) == np.count_nonzero(keyframe.labels) <= 100
    np.testing.assert_array_equal(keyframe.T_map_camera, POSES[1])
    assert keyframe.stamp_ns == 1


def test_a_frames_own_image_may_change_afterwards() -> None:
    fusion, seen = Fusion(COARSE), view(POSES[0], ROOM + THREE)
    fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(POSES[0]), 0)
    before = to_lattice(seen.colour.copy(), seen.depth.copy(), seen.heat, CAMERA, CAMERA.width)
    seen.depth.fill(0)
    seen.colour.fill(0)
    fusion.observe(segments(), 0)
    (keyframe,) = fusion.consensus.take_waiting()
    np.testing.assert_array_equal(keyframe.depth, before.depth)
    np.testing.assert_array_equal(keyframe.colour, before.colour)


def test_segments_of_frames_that_are_not_known_are_refused() -> None:
    fusion = Fusion(COARSE)
    for stamp in range(62):
        fusion.fuse(*BLANK, CAMERA, CameraPose(POSES[0]), stamp)
    assert not fusion.observe(segments(), 1), "sixty frames are remembered"
    assert fusion.observe(segments(), 2)
    assert not fusion.observe(segments(), 2), "once"
    assert not fusion.observe(segments(), 77)
    assert len(fusion.consensus) == 1


def test_clusters_by_density_keep_no_keyframes() -> None:
    fusion = Fusion(COARSE.model_copy(update={"clustering": "density"}))
    fused(fusion, 3)
    assert all(fusion.observe(segments(), stamp) for stamp in range(3))
    assert len(fusion.consensus) == 0


def test_a_stamp_that_comes_again_is_the_latest_frames() -> None:
    fusion = Fusion(COARSE)
    for stamp in (0, 1, 0, *range(2, 61)):
        fusion.fuse(*BLANK, CAMERA, CameraPose(POSES[0]), stamp)
    assert not fusion.observe(segments(), 1), "the first of sixty-one"
    assert fusion.observe(segments(), 0)


def test_the_oldest_keyframes_that_wait_go() -> None:
    fusion = Fusion(COARSE.model_copy(update={"keyframe_limit": 2}))
    fused(fusion, 4)
    for stamp in range(4):
        assert fusion.observe(segments(), stamp)
    assert [keyframe.stamp_ns for keyframe in fusion.consensus.take_waiting()] == [2, 3]
    assert fusion.consensus.dropped == 2


def test_reset_forgets_them() -> None:
    fusion = Fusion(COARSE)
    fused(fusion, 2)
    fusion.observe(segments(), 0)
    fusion.reset()
    assert (len(fusion.consensus), fusion.consensus.dropped) == (0, 0)
    assert not fusion.observe(segments(), 1)


def test_segments_of_an_absurdly_wide_view_take_no_more_memory_than_others() -> None:
    fusion = Fusion(COARSE)
    fused(fusion, 2)
    wide = replace(segments(), camera=replace(CAMERA, fx=CAMERA.fx / 3000, fy=CAMERA.fy / 3000))
    wide.labels.fill(1)
    tracemalloc.start()
    try:
        assert fusion.observe(wide, 0)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
    assert fusion.observe(replace(wide, camera=replace(wide.camera, fx=5e-324)), 1)


def test_what_spills_onto_another_thing_goes_as_what_spills_onto_the_wall() -> None:
    """The label of a thing behind reaches a pixel too far onto the one in front, and the front one's onto the wall."""
    depth = np.full((30, 40), 2.0, np.float32)
    depth[5:25, 5:20], depth[5:25, 20:35] = 1.0, 1.3
    labels = np.zeros((30, 40), np.uint8)
    labels[5:25, 19:35], labels[4:25, 5:19] = 2, 1
    kept = without_spill(labels, depth, 1)
    assert not kept[4].any()
    assert not kept[:, 19].any()
    assert (kept[5:25, 5:19] == 1).all()
    assert (kept[5:25, 20:35] == 2).all()


def test_what_is_too_narrow_to_have_an_inside_stays() -> None:
    depth, labels = np.full((9, 9), 1.0, np.float32), np.zeros((9, 9), np.uint8)
    labels[4, 2:7] = 1
    np.testing.assert_array_equal(without_spill(labels, depth, 1), labels)
