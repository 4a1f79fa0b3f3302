"""What keyframes saw is where it would be, had the camera's calibration been known with them."""

from dataclasses import replace

import numpy as np
import pytest
from voting_room import keyframes

from spot3d.calibration import NOMINAL, Bend, Calibration, moved_planes, sheared
from spot3d.fusion.objects.recalibration import Change, Placement, change_segments, changed_view
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import FAR, view_of
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_from_vector


def test_a_changed_keyframe_is_one_that_was_seen_like_that() -> None:
    before, now = (
        Calibration(1.0, (0.02, 0.0, -0.01), (0.01, 0.0)),
        Calibration(1.03, (-0.01, 0.03, 0.02), (0.02, -0.03)),
    )
    first = keyframes()[0]
    T = first.T_map_camera.copy()
    T[:3, :3] = T[:3, :3] @ rotation_from_vector(np.array(before.turn)).T @ rotation_from_vector(np.array(now.turn))
    shift = (now.centre[0] - before.centre[0], now.centre[1] - before.centre[1])
    step = Calibration(now.depth_factor, centre=shift)
    planes = moved_planes(first.planes, step.depth_factor * sheared(shift), np.zeros(3))
    camera, depth = step.camera(first.camera), step.metres(first.depth)
    then = replace(first, T_map_camera=T, depth=depth, planes=planes, camera=camera)
    changed, seen = SegmentTable(), SegmentTable()
    changed.extend(first, 0)
    seen.extend(then, 0)
    change = Change.of(view_of(first), Placement(0, before), Placement(0, now))
    change_segments(changed, np.arange(len(changed)), change)
    for name, within in (("places", 1e-4), ("support", 2e-3), ("blur", 1e-3)):
        np.testing.assert_allclose(getattr(changed, name).rows, getattr(seen, name).rows, atol=within, err_msg=name)
    np.testing.assert_allclose(changed.spheres.rows[:, 3], seen.spheres.rows[:, 3], rtol=0.1)
    view, other = changed_view(view_of(first), change), view_of(then)
    np.testing.assert_allclose(view.pose, other.pose, atol=1e-5)
    np.testing.assert_allclose(view.focal, other.focal, atol=1e-3)
    np.testing.assert_allclose(view.centre, other.centre, atol=1e-2)
    np.testing.assert_allclose(view.depth, other.depth, atol=2)


def test_a_keyframe_that_is_straightened_is_one_that_was_seen_straight() -> None:
    """Whatever of it was known before; what bends all alike is another factor of depth."""
    first, known = keyframes()[0], Calibration(bend=((0.0, 0.01, 0.02, 0.01, 0.0, 0.01),) * 4)
    grid = 0.03 * np.random.default_rng(0).random((4, 6))
    bend: Bend = tuple(tuple(row) for row in grid.tolist())
    for then, now, step in (
        (NOMINAL, Calibration(bend=bend), Calibration(bend=bend)),
        (known, NOMINAL, Calibration(bend=((0.0, -0.01, -0.02, -0.01, 0.0, -0.01),) * 4)),
        (NOMINAL, Calibration(bend=((float(np.log(1.03)),) * 6,) * 4), Calibration(1.03)),
    ):
        changed, seen = SegmentTable(), SegmentTable()
        planes = moved_planes(first.planes, step.depth_factor * np.eye(3), np.zeros(3))
        straight = replace(first, depth=step.metres(first.depth), planes=planes)
        changed.extend(first, 0)
        seen.extend(straight, 0)
        change = Change.of(view_of(first), Placement(0, then), Placement(0, now))
        change_segments(changed, np.arange(len(changed)), change)
        np.testing.assert_allclose(changed.places.rows, seen.places.rows, atol=5e-4)
        if not step.bend:
            np.testing.assert_allclose(changed.support.rows, seen.support.rows, atol=2e-3)
            np.testing.assert_allclose(changed.blur.rows, seen.blur.rows, atol=1e-3)
        reach = np.linalg.norm(changed.places.rows - changed.spheres.rows[:, None, :3], axis=2).max(axis=1)
        assert (reach <= 1.001 * changed.spheres.rows[:, 3]).all()
        view, other = changed_view(view_of(first), change), view_of(straight)
        np.testing.assert_allclose(view.depth, other.depth, atol=2, rtol=1e-3)
        np.testing.assert_allclose(view.centre, other.centre, atol=1e-2)


def test_a_keyframe_whose_pose_is_corrected_is_one_that_was_posed_like_that() -> None:
    """From one correction to the next, along with the camera's calibration."""
    first, twist = keyframes()[0], np.array((0.02, -0.03, 0.01, 0.02, -0.01, 0.03))
    known = Calibration(1.02, (-0.01, 0.03, 0.02))
    before = np.array((0.01, 0.0, -0.02, 0.0, 0.02, 0.01))
    placed, truly = first.T_map_camera.copy(), first.T_map_camera.copy()
    for pose, by in ((placed, before), (truly, twist)):
        pose[:3, :3] = rotation_from_vector(by[3:]) @ pose[:3, :3]
        pose[:3, 3] += by[:3]
    truly[:3, :3] = truly[:3, :3] @ rotation_from_vector(np.array(known.turn))
    step = Calibration(known.depth_factor)
    planes = moved_planes(first.planes, known.depth_factor * np.eye(3), np.zeros(3))
    then = replace(first, T_map_camera=truly, depth=step.metres(first.depth), planes=planes)
    changed, seen = SegmentTable(), SegmentTable()
    first = replace(first, T_map_camera=placed)
    changed.extend(first, 0)
    seen.extend(then, 0)
    by_then, by_now = Placement(0, NOMINAL, tuple(before)), Placement(0, known, tuple(twist))
    change = Change.of(view_of(first), by_then, by_now)
    change_segments(changed, np.arange(len(changed)), change)
    for name, within in (("places", 1e-4), ("support", 2e-3), ("blur", 1e-3)):
        np.testing.assert_allclose(getattr(changed, name).rows, getattr(seen, name).rows, atol=within, err_msg=name)
    view, other = changed_view(view_of(first), change), view_of(then)
    np.testing.assert_allclose(view.pose, other.pose, atol=1e-5)
    np.testing.assert_allclose(view.centre, other.centre, atol=1e-2)


def test_the_outline_of_what_is_torn_moves_with_its_places() -> None:
    first, segments = keyframes()[0], SegmentTable()
    segments.extend(first, 0)
    outline = segments.outline.rows
    outline[0] = segments.places.rows[0, : outline.shape[1]]
    now = Placement(0, Calibration(1.05), (0.1, 0.0, -0.2, 0.5, -0.4, 0.3))
    change_segments(segments, np.arange(len(segments)), Change.of(view_of(first), Placement(0, NOMINAL), now))
    np.testing.assert_array_equal(outline[0], segments.places.rows[0, : outline.shape[1]])
    assert np.isnan(outline[1:]).all()


def test_noise_scatters_along_the_rays_however_far_a_keyframe_turns() -> None:
    first, segments = keyframes()[0], SegmentTable()
    segments.extend(first, 0)
    scatter = np.linalg.norm(segments.blur.rows, axis=1)
    now = Placement(0, Calibration(1.05), (0.1, 0.0, -0.2, 0.5, -0.4, 0.3))
    change = Change.of(view_of(first), Placement(0, NOMINAL), now)
    change_segments(segments, np.arange(len(segments)), change)
    rays = segments.places.rows.mean(axis=1) - change.camera - change.step
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(segments.blur.rows, 1.05 * scatter[:, None] * rays, atol=1e-6)


@pytest.mark.parametrize("depth", [65_000, FAR])
def test_what_comes_to_lie_beyond_16_bits_of_millimetres_or_was_is_far(depth: int) -> None:
    view = replace(view_of(keyframes()[0]), depth=np.full((2, 2), depth, np.uint16))
    for factor in (1.02, 0.98):
        change = Change.of(view, Placement(0, NOMINAL), Placement(0, Calibration(factor)))
        is_far = changed_view(view, change).depth == FAR
        assert is_far.all() == (factor > 1 or depth == FAR)


def test_a_pose_is_corrected_by_more_than_a_share_of_a_pixels_noise_alone() -> None:
    placed = Placement(5, NOMINAL, (0.01, 0.0, 0.0, 0.0, 0.0, 0.0))
    for shift, follows in ((0.0103, False), (0.0107, True), (-0.01, True)):
        told = PoseCorrections(np.array([0]), np.array([[shift, 0, 0, 0, 0, 0]]))
        assert (placed.by_now(NOMINAL, told) != placed) == follows
    later = PoseCorrections(np.array([6]), np.ones((1, 6)))
    assert placed.by_now(NOMINAL, later) == placed.by_now(NOMINAL, None) == placed
    assert placed.by_now(Calibration(1.1), later) == Placement(5, Calibration(1.1), placed.twist)


def test_changes_back_and_forth_end_where_they_began() -> None:
    first = keyframes()[0]
    bend = ((0.01, 0.0, -0.01, 0.02, 0.0, 0.0),) * 4
    segments, known = SegmentTable(), Calibration(1.02, (0.02, -0.01, 0.01), (0.01, -0.02), bend)
    segments.extend(first, 0)
    tables = {name: getattr(segments, name).rows.copy() for name in ("places", "support", "blur")}
    view = view_of(first)
    told, placed = Placement(0, NOMINAL), Placement(0, known, (0.02, -0.01, 0.03, 0.01, 0.02, -0.01))
    for before, now in [(told, placed), (placed, told)] * 20:
        change = Change.of(view, before, now)
        change_segments(segments, np.arange(len(segments)), change)
        view = changed_view(view, change)
    for name, rows in tables.items():
        np.testing.assert_allclose(getattr(segments, name).rows, rows, atol=1e-4, err_msg=name)
    np.testing.assert_allclose(view.pose, view_of(first).pose, atol=1e-5)
