"""Registration of frames with the map: the warp of Eqs. 12-14, running means, the voxel look-up, the limit."""

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE, ROOM, THREE, View, look_at, orbit, view
from hypothesis import given, settings
from hypothesis import strategies as st

from spot3d.bench.reference import warp as reference_warp
from spot3d.camera import Intrinsics, back_project
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.index_map import IndexMap, MatchCounts, warp
from spot3d.fusion.map.map_arrays import FREQUENCY, HEAT, WEIGHT, X
from spot3d.fusion.map.merging import Pixels
from spot3d.fusion.settings import FusionSettings
from spot3d.sensor import pinhole
from spot3d.voxel_hash import find_slot

POSE = look_at((0.0, -0.95, 0.7))
TINY = Intrinsics(12.0, 11.0, 5.3, 3.9, 12, 9)


class Mapper:
    """A map and the index map that fills it, frame by frame."""

    def __init__(self, **changes: float) -> None:
        self.settings = COARSE.model_copy(update=changes)
        self.heatmap = Heatmap3D(self.settings.map_limit, self.settings.voxel)
        self.index_map = IndexMap(self.settings)
        self.frames = 0

    def see(self, seen: View, pose: np.ndarray, camera: Intrinsics = CAMERA) -> MatchCounts:
        self.frames += 1
        return self.index_map.register(self.heatmap, self.frames, seen.colour, seen.depth, seen.heat, camera, pose)

    def column(self, index: int) -> np.ndarray:
        return self.heatmap.points()[:, index]


def random_frames(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    shape = TINY.shape
    last_index = np.where(rng.random(shape) < 0.8, rng.integers(0, 500, shape), -1).astype(np.int32)
    smooth = rng.uniform(0.8, 1.2)
    depths = [np.where(rng.random(shape) < 0.9, smooth + rng.uniform(0, 0.02, shape), 0) for _ in range(2)]
    colours = [rng.integers(100, 140, (*shape, 3), np.uint8) for _ in range(2)]
    angle = rng.normal(0, 0.05, 3)
    T = np.eye(4)
    skew = np.array([[0, -angle[2], angle[1]], [angle[2], 0, -angle[0]], [-angle[1], angle[0], 0]])
    T[:3, :3] = np.linalg.qr(np.eye(3) + skew)[0] * np.array([-1, -1, -1])
    T[:3, 3] = rng.normal(0, 0.05, 3)
    T[2, 3] += rng.choice([0.0, 0.3])
    return last_index, depths[0].astype(np.float32), colours[0], depths[1].astype(np.float32), colours[1], T


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1), colour_gate=st.sampled_from([0.05, 0.1, 0.5]), z_gate=st.sampled_from([0.01, 0.3])
)
def test_warp_equals_the_plain_transcription(seed: int, colour_gate: float, z_gate: float) -> None:
    last_index, last_depth, last_colour, depth, colour, T = random_frames(seed)
    T = T.astype(np.float32)
    kernel, nearest = np.full(TINY.shape, -1, np.int32), np.full(TINY.shape, np.inf, np.float32)
    cold = np.zeros(TINY.shape, np.uint8)
    warp(
        last_index, Pixels(last_depth, last_colour, cold), Pixels(depth, colour, cold), T, pinhole(TINY),
        IndexMap(FusionSettings(colour_gate=colour_gate, depth_gate=z_gate, noise_gate=0)).how, nearest, kernel,
    )  # fmt: skip
    plain = reference_warp(last_index, last_depth, last_colour, depth, colour, T, TINY, colour_gate, z_gate)
    np.testing.assert_array_equal(kernel, plain)


@pytest.mark.parametrize(
    ("cx", "away", "row", "expected"),
    [
        (0.0, (1.02, 1.0, 1.01), (1e-3, 0, 0, 0), [5, -1, -1]),  # all three land on the first pixel: the nearest wins
        (1.0, (1.0, 1.0, 1.0), (1, 0, 0, -0.1), [5, 6, -1]),  # what leaves at the left is not seen at the right
    ],
)
def test_three_pixels_by_hand(cx: float, away: tuple[float, ...], row: tuple[float, ...], expected: list[int]) -> None:
    line, colour, motion = Intrinsics(10.0, 10.0, cx, 0.0, 3, 1), np.full((1, 3, 3), 9, np.uint8), np.eye(4, dtype="f4")
    motion[0] = row
    found, nearest = np.full((1, 3), -1, np.int32), np.full((1, 3), np.inf, np.float32)
    cold = np.zeros((1, 3), np.uint8)
    warp(
        np.array([[4, 5, 6]], np.int32), Pixels(np.array([away], np.float32), colour, cold),
        Pixels(np.ones((1, 3), np.float32), colour, cold), motion, pinhole(line),
        IndexMap(FusionSettings(colour_gate=1 / 255, depth_gate=0.1, noise_gate=0)).how, nearest, found,
    )  # fmt: skip
    np.testing.assert_array_equal(found, [expected])


def test_a_camera_that_goes_ahead_finds_the_last_frames_points_by_the_warp_alone() -> None:
    mapper, ahead = Mapper(look_up=False), np.eye(4)
    ahead[2, 3] = 0.05
    black, cold = np.zeros((*CAMERA.shape, 3), np.uint8), np.zeros(CAMERA.shape, np.uint8)
    for pose, away in ((np.eye(4), 1.0), (ahead, 0.95)):
        counts = mapper.see(View(black, np.full(CAMERA.shape, away, np.float32), cold), pose)
    assert counts.warped > 0.8 * cold.size


@pytest.mark.parametrize(("difference", "met"), [(40, True), (60, False)])
def test_pixels_match_whose_colours_differ_by_a_fifth_at_most(difference: int, met: bool) -> None:
    mapper, wall = Mapper(look_up=False, colour_gate=0.2), np.ones(CAMERA.shape, np.float32)
    for shade in (0, difference):
        colour = np.zeros((*CAMERA.shape, 3), np.uint8)
        colour[..., 1] = shade
        counts = mapper.see(View(colour, wall, np.zeros(CAMERA.shape, np.uint8)), np.eye(4))
    assert counts.warped == (wall.size if met else 0)


def test_a_frame_after_a_break_is_not_warped() -> None:
    mapper, seen = Mapper(), view(POSE, ROOM)
    mapper.see(seen, POSE)
    mapper.index_map = IndexMap(mapper.settings)
    again = mapper.see(seen, POSE)
    assert (again.warped, again.found) == (0, np.count_nonzero(seen.depth))


def test_the_same_view_twice_adds_nothing() -> None:
    mapper, seen = Mapper(), view(POSE, ROOM + THREE)
    first = mapper.see(seen, POSE)
    assert (first.warped, first.found + first.appended) == (0, np.count_nonzero(seen.depth))
    second = mapper.see(seen, POSE)
    assert second == MatchCounts(warped=np.count_nonzero(seen.depth), found=0, appended=0)
    assert mapper.heatmap.count == first.appended
    assert (mapper.column(FREQUENCY) == 2).all()
    assert np.isfinite(mapper.heatmap.points()).all()


def test_heat_and_frequency_grow_once_a_frame_however_many_pixels_share_a_point() -> None:
    mapper = Mapper(voxel=0.1)
    black, hot = np.zeros((*CAMERA.shape, 3), np.uint8), np.full(CAMERA.shape, 255, np.uint8)
    for frame in (1, 2, 3):
        mapper.see(View(black, np.ones(CAMERA.shape, np.float32), hot), np.eye(4))
        assert (mapper.column(FREQUENCY) == frame).all()
        assert (mapper.column(HEAT) == frame).all()
        assert (mapper.heatmap.last_seen() == frame).all()
    assert mapper.heatmap.count < 200


def test_frames_are_told_apart_beyond_what_single_precision_counts() -> None:
    mapper, seen = Mapper(), view(POSE, ROOM + THREE)
    mapper.frames = 2**24
    for frequency in (1, 2, 3):
        mapper.see(seen, POSE)
        assert (mapper.column(FREQUENCY) == frequency).all()
    assert (mapper.heatmap.last_seen() == 2**24 + 3).all()


def test_frames_may_be_counted_from_zero() -> None:
    mapper = Mapper()
    mapper.frames = -1
    mapper.see(view(POSE, ROOM), POSE)
    assert (mapper.column(FREQUENCY) == 1).all()


def test_positions_are_running_means() -> None:
    mapper = Mapper()
    one = Intrinsics(100.0, 100.0, 0.0, 0.0, 1, 1)
    depths = [1.000, 1.004, 1.002]
    for z in depths:
        pixel = View(np.full((1, 1, 3), 50, np.uint8), np.full((1, 1), z, np.float32), np.zeros((1, 1), np.uint8))
        mapper.see(pixel, np.eye(4), one)
    assert mapper.heatmap.count == 1
    np.testing.assert_allclose(mapper.heatmap.points()[0, X : X + 3], [0, 0, np.mean(depths)], atol=1e-4)
    assert mapper.column(WEIGHT)[0] > 0


def test_a_sample_weighs_the_more_the_less_noise_its_depth_has() -> None:
    """The same place, seen from 3 m and from 1 m away with depth that is off by a centimetre to either side."""
    mapper, one = Mapper(look_up=True, voxel=0.1, noise_gate=0.0), Intrinsics(100.0, 100.0, 0.0, 0.0, 1, 1)
    for away, off in ((3.0, -0.01), (1.0, 0.01)):
        pose = np.eye(4)
        pose[2, 3] = 3.05 - away
        black, cold = np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.uint8)
        mapper.see(View(black, np.full((1, 1), away + off, np.float32), cold), pose, one)
    assert mapper.heatmap.count == 1
    assert mapper.column(X + 2)[0] == pytest.approx(3.06, abs=0.001)


def test_noise_averages_out() -> None:
    mapper, rng = Mapper(), np.random.default_rng(0)
    wall = np.full(CAMERA.shape, 1.5, np.float32)
    for _ in range(12):
        noisy = wall + rng.normal(0, 0.003, wall.shape).astype(np.float32)
        mapper.see(View(np.zeros((*wall.shape, 3), np.uint8), noisy, np.zeros(wall.shape, np.uint8)), np.eye(4))
    often = mapper.heatmap.points()[mapper.column(FREQUENCY) >= 10]
    assert len(often) > 0.9 * wall.size
    assert np.sqrt(np.mean((often[:, X + 2] - 1.5) ** 2)) < 0.0015


def test_a_revisited_surface_finds_its_points() -> None:
    mapper, away = Mapper(), look_at((0.0, -0.95, 0.7), (0, -3, 0.5))
    seen = view(POSE, ROOM + THREE)
    mapper.see(seen, POSE)
    mapper.see(view(away, ROOM + THREE), away)
    before = mapper.heatmap.count
    again = mapper.see(seen, POSE)
    assert again.warped == 0
    assert again.found == np.count_nonzero(seen.depth)
    assert again.appended == 0
    assert mapper.heatmap.count == before


def test_a_point_is_looked_for_along_the_ray_wherever_the_camera_is() -> None:
    mapper, one, pose = Mapper(noise_gate=9.0), Intrinsics(100.0, 100.0, 0.0, 0.0, 1, 1), np.eye(4)
    pose[:3, 3] = (40.0, -30.0, 0.0)
    for away in (1.5, 1.51):
        pixel = View(np.zeros((1, 1, 3), np.uint8), np.full((1, 1), away, np.float32), np.zeros((1, 1), np.uint8))
        mapper.index_map = IndexMap(mapper.settings)
        mapper.see(pixel, pose, one)
    assert mapper.heatmap.count == 1


@pytest.mark.parametrize(("apart", "points"), [(0.07, 1), (0.3, 2)])
def test_another_surface_far_away_is_no_noise(apart: float, points: int) -> None:
    """At 12 m three deviations are 0.8 m."""
    mapper, one = Mapper(range_max=100.0), Intrinsics(100.0, 100.0, 0.0, 0.0, 1, 1)
    for away in (12.0, 12.0 + apart):
        pixel = View(np.zeros((1, 1, 3), np.uint8), np.full((1, 1), away, np.float32), np.zeros((1, 1), np.uint8))
        mapper.index_map = IndexMap(mapper.settings)
        mapper.see(pixel, np.eye(4), one)
    assert mapper.heatmap.count == points


def test_the_map_stops_growing() -> None:
    mapper, rng = Mapper(), np.random.default_rng(2)
    poses = orbit(6)
    for pose in poses:
        mapper.see(view(pose, ROOM + THREE, rng), pose)
    once = mapper.heatmap.count
    appended = [mapper.see(view(pose, ROOM + THREE, rng), pose).appended for pose in poses * 3]
    assert sum(appended[-6:]) < 0.15 * once
    assert np.isfinite(mapper.heatmap.points()).all()


def test_other_intrinsics_mid_stream_meet_the_map_through_its_voxels() -> None:
    mapper, wide = Mapper(), Intrinsics(75.0, 75.0, 39.5, 29.5, 80, 60)
    mapper.see(view(POSE, ROOM + THREE), POSE)
    seen = view(POSE, ROOM + THREE, camera=wide)
    second = mapper.see(seen, POSE, wide)
    assert second.warped == 0
    assert second.found > 0.3 * np.count_nonzero(seen.depth)
    third = mapper.see(seen, POSE, wide)
    assert third.warped == np.count_nonzero(seen.depth)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, 4.1])
def test_depth_that_is_invalid_or_too_far_is_not_fused(value: float) -> None:
    mapper, seen = Mapper(range_max=4.0), view(POSE, ROOM)
    seen.depth[:60] = value
    result = mapper.see(seen, POSE)
    assert result.found + result.appended == np.count_nonzero(seen.depth[60:])
    assert np.isfinite(mapper.heatmap.points()).all()


@pytest.mark.parametrize("limit", [1000, 20_000, 30_000])
def test_a_full_map_stays_within_its_limit_and_consistent(limit: int) -> None:
    mapper, rng = Mapper(map_limit=limit), np.random.default_rng(3)
    for pose in orbit(8, turn=4.0):
        result = mapper.see(view(pose, ROOM + THREE, rng), pose)
        assert 0 < mapper.heatmap.count <= limit
        assert result.appended > 0
        assert (mapper.heatmap.last_seen() == mapper.frames).sum() >= result.appended
    assert mapper.heatmap.evicted > 0
    taken, known = np.flatnonzero(mapper.column(FREQUENCY) > 0), mapper.heatmap.arrays
    assert mapper.heatmap.count == len(taken) == np.count_nonzero(known.keys >= 0)
    slots = known.row_slots[taken]
    np.testing.assert_array_equal(known.slot_rows[slots], taken)
    assert [find_slot(known.keys, key) for key in known.keys[slots]] == slots.tolist()


def test_rows_that_points_have_left_are_taken_again() -> None:
    limit = 20_000
    mapper, rng = Mapper(map_limit=limit), np.random.default_rng(3)
    added = sum(mapper.see(view(pose, ROOM + THREE, rng), pose).appended for pose in orbit(8, turn=4.0))
    assert added > limit
    assert mapper.heatmap.count == added - mapper.heatmap.evicted


def test_the_last_frames_points_that_had_to_make_room_are_not_met_again() -> None:
    """Cold points go first, even of the last frame: what warps onto one of these is a new point."""
    mapper = Mapper(map_limit=1000, tau=0.0)
    camera = Intrinsics(24.0, 24.0, 11.5, 11.5, 24, 24)
    black, wall, cold = np.zeros((24, 24, 3), np.uint8), np.ones((24, 24), np.float32), np.zeros((24, 24), np.uint8)
    aside = np.eye(4)
    aside[0, 3] = 5.0
    mapper.see(View(black, wall, cold + np.uint8(255)), aside, camera)
    for _ in range(2):
        mapper.see(View(black, wall, cold), np.eye(4), camera)
    assert mapper.heatmap.evicted > 0
    free = mapper.heatmap.arrays.free[: mapper.heatmap.free_count]
    assert (mapper.column(FREQUENCY)[free] == 0).all()
    assert mapper.heatmap.count == np.count_nonzero(mapper.column(FREQUENCY))


def test_a_point_lies_where_its_pixel_was() -> None:
    mapper, seen = Mapper(voxel=0.0011), view(POSE, ROOM + THREE)
    mapper.see(seen, POSE)
    points = back_project(seen.depth, CAMERA)[seen.depth > 0] @ POSE[:3, :3].T + POSE[:3, 3]
    assert mapper.heatmap.count == len(points)
    np.testing.assert_allclose(mapper.heatmap.points()[:, X : X + 3], points, atol=1e-5)


def test_a_camera_that_stands_still_for_days_loses_nothing_of_what_it_adds() -> None:
    """A point's sums are halved together; of single precision 2^24 and 1 is 2^24."""
    mapper, seen = Mapper(), view(POSE, ROOM)
    mapper.see(seen, POSE)
    rows = mapper.heatmap.points()
    rows[:, FREQUENCY], rows[:, HEAT] = 65_530, 0.6 * 65_530
    weight = rows[:, WEIGHT].copy()
    place = rows[:, X : X + 3].copy()
    frequent = rows[:, FREQUENCY].copy()
    for _ in range(20):
        mapper.see(seen, POSE)
        assert rows[:, FREQUENCY].max() < 65_536
        assert (rows[:, FREQUENCY] != frequent).all(), "every frame counts"
        frequent = rows[:, FREQUENCY].copy()
    np.testing.assert_allclose(rows[:, HEAT] / rows[:, FREQUENCY], 0.6, atol=1e-3)
    np.testing.assert_allclose(rows[:, X : X + 3], place, atol=1e-4)
    assert (rows[:, WEIGHT] < 20 * weight).all(), "of 21 samples some are half forgotten"
