"""What things stand on: the plane that holds heat and faces up, and heights above it though depth is bent."""

import tracemalloc

import cv2
import numpy as np
import pytest
from fusion_room import CAMERA, FLOOR, ROOM, THREE, Cuboid, View, look_at, view
from fusion_room import WALL as BACK
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project, invert
from spot3d.geometry.normals import surface_normals
from spot3d.geometry.planes import on_plane, transform_plane
from spot3d.segments.settings import SegmentsSettings, Step
from spot3d.segments.supports import (
    _outermost,
    above_extent,
    beside_support,
    choose_support,
    clearly_faces,
    expected_up,
    heights_and_tolerance,
    held_heat,
    noise_height,
)
from spot3d.segments.upper_side import IMAGE_UP

SETTINGS = SegmentsSettings()
POSE = look_at((0, -0.95, 0.7))
TABLE = transform_plane(np.array([0, 0, 1.0, 0]), invert(POSE))
WALL = transform_plane(np.array([0, -1.0, 0, 1.5]), invert(POSE))
POINTS = back_project(view(POSE, ROOM).depth, CAMERA)
NORMALS = surface_normals(view(POSE, ROOM).depth, CAMERA)
COLD = np.zeros(CAMERA.shape, np.uint8)


def heat_on(plane: NDArray[np.float64], value: int) -> NDArray[np.uint8]:
    return np.where(on_plane(plane, POINTS, SETTINGS), value, 0).astype(np.uint8)


def chosen(planes: list[NDArray[np.float64]], heat: NDArray[np.uint8], image_up: str = "top") -> int | None:
    """Which of the planes is chosen, by its number."""
    candidates = np.array(planes).reshape(-1, 4)
    found = choose_support(candidates, held_heat(candidates, POINTS, NORMALS, heat, SETTINGS), IMAGE_UP[image_up])
    return None if found is None else next(k for k, plane in enumerate(planes) if np.array_equal(plane, found))


def test_of_two_tables_the_warmer_one_is_chosen() -> None:
    pose = look_at((0, -1.5, 0.9), (0, -0.3, 0))
    depth = view(pose, ROOM).depth
    points, normals = back_project(depth, CAMERA), surface_normals(depth, CAMERA)
    planes = np.array([transform_plane(np.array((0, 0, 1.0, below)), invert(pose)) for below in (0, 0.75)])
    for warmer in planes:
        heat = np.where(on_plane(warmer, points, SETTINGS), 20, 0).astype(np.uint8)
        held = held_heat(planes, points, normals, heat, SETTINGS)
        np.testing.assert_array_equal(choose_support(planes, held, IMAGE_UP["top"]), warmer)


def test_a_front_is_no_support_though_it_holds_more_heat() -> None:
    heat = np.maximum(heat_on(WALL, 250), heat_on(TABLE, 10))
    assert int(heat[on_plane(WALL, POINTS, SETTINGS)].sum()) > int(heat[on_plane(TABLE, POINTS, SETTINGS)].sum())
    assert chosen([WALL, TABLE], heat) == 1
    assert chosen([WALL], heat) == 0, "the only one that there is"


@pytest.mark.parametrize("planes", [[], [TABLE, WALL]])
def test_where_nothing_is_warm_nothing_supports(planes: list[NDArray[np.float64]]) -> None:
    assert chosen(planes, COLD) is None


@pytest.mark.parametrize("image_up", ["top", "bottom", "left", "right"])
def test_a_camera_may_be_mounted_on_any_side(image_up: str) -> None:
    """The same scene in the frame of a camera that is turned about its axis."""
    x, y, _ = IMAGE_UP[image_up]
    turn = np.array([[-y, -x, 0], [x, -y, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(turn @ (0, -1, 0), (x, y, 0), atol=1e-12)
    planes = np.array([np.append(turn @ plane[:3], plane[3]) for plane in (WALL, TABLE)])
    heat = np.maximum(heat_on(WALL, 250), heat_on(TABLE, 10))
    points, normals = ((seen @ turn.T).astype(np.float32) for seen in (POINTS, NORMALS))
    support = choose_support(planes, held_heat(planes, points, normals, heat, SETTINGS), IMAGE_UP[image_up])
    assert support is not None
    np.testing.assert_array_equal(support, planes[1])


def test_from_straight_above_a_table_is_what_faces_the_camera() -> None:
    """The side of a box that faces the image's upper side is seen as well, and is hotter."""
    down = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.0], [0, 0, 0, 1]])
    box = Cuboid((0, -0.3, 0.1), (0.3, 0.1, 0.2))
    depth = view(down, (ROOM[0], box)).depth
    points, normals = back_project(depth, CAMERA), surface_normals(depth, CAMERA)
    planes = np.array([[0, 0, 1.0, 0], [0, 1.0, 0, 0.25]]) @ down
    heat = np.full(CAMERA.shape, 40, np.uint8)
    heat[on_plane(planes[1], points, SETTINGS)] = 255
    held = held_heat(planes, points, normals, heat, SETTINGS)
    support = choose_support(planes, held, expected_up("top"))
    assert support is not None
    np.testing.assert_array_equal(support, planes[0])
    wrong = choose_support(planes, held, IMAGE_UP["top"])
    assert wrong is not None
    np.testing.assert_array_equal(wrong, planes[1])


def test_what_only_touches_the_edges_of_stairs_is_no_support() -> None:
    """A plane through the edges of all steps is near to more pixels than any tread, and faces as none of them does."""
    steps = tuple(Cuboid((0, -0.3 + 0.28 * k, 0.085 * (k + 1)), (2, 0.28, 0.17 * (k + 1))) for k in range(5))
    pose = look_at((0, -1.4, 1.5), (0, 0.25, 0.4))
    depth = view(pose, steps).depth
    points, normals, heat = (
        back_project(depth, CAMERA),
        surface_normals(depth, CAMERA),
        np.full(CAMERA.shape, 40, np.uint8),
    )
    across = np.array((0, -0.17, 0.28)) / np.hypot(0.17, 0.28)
    through = [np.append(across, -across @ (0, -0.44, 0.17) + off) for off in (0.0, 0.01, 0.02)]
    treads = [np.array((0, 0, 1.0, -0.17 * (k + 1))) for k in range(5)]
    planes = np.array([transform_plane(plane, invert(pose)) for plane in through + treads])
    near = [np.count_nonzero(on_plane(plane, points, SETTINGS)) for plane in planes]
    assert max(near[:3]) > max(near[3:])
    support = choose_support(planes, held_heat(planes, points, normals, heat, SETTINGS), expected_up("top"))
    assert any(np.array_equal(support, plane) for plane in planes[3:])


@pytest.mark.parametrize("looks_down", [0, 10, 30, 60, 85])
@pytest.mark.parametrize("image_up", ["top", "bottom", "left", "right"])
def test_a_table_faces_what_is_expected_to_be_up_and_a_wall_hardly_does(image_up: str, looks_down: float) -> None:
    upper, forward, pitch = IMAGE_UP[image_up], np.array((0.0, 0.0, 1.0)), np.radians(looks_down)
    table = np.cos(pitch) * upper - np.sin(pitch) * forward
    wall = -np.sin(pitch) * upper - np.cos(pitch) * forward
    expected = expected_up(image_up)
    assert np.linalg.norm(expected) == pytest.approx(1)
    assert expected @ table > max(0.3, 3 * expected @ wall)


@pytest.mark.parametrize(("looks_down", "expected"), [(0, True), (45, True), (70, True), (75, False), (90, False)])
def test_a_table_is_clearly_one_unless_it_is_seen_from_above(looks_down: float, expected: bool) -> None:
    pitch = np.radians(looks_down)
    table = np.array([[0, -np.cos(pitch), -np.sin(pitch), 1.0]])
    assert clearly_faces(table, "top") == expected
    assert not clearly_faces(table, "bottom")


@pytest.mark.parametrize("looks_down", [-15, -10, 0, 10, 45])
def test_a_wall_is_never_clearly_a_support(looks_down: float) -> None:
    pitch = np.radians(looks_down)
    wall = np.array([[0, np.sin(pitch), -np.cos(pitch), 1.0]])
    assert not any(clearly_faces(wall, side) for side in ("top", "left", "right"))
    assert not clearly_faces(np.zeros((0, 4)), "top")
    table = np.array([[0, -1.0, 0, 1.0]])
    assert not clearly_faces(np.concatenate((wall, table)), "top"), "the first is the main one"


def bent(depth: NDArray[np.float32], by: float) -> NDArray[np.float32]:
    """Depth that is too large at the middle of the image and too small at its corners, as a sensor bends it, metres."""
    v, u = np.mgrid[-1 : 1 : 1j * depth.shape[0], -1 : 1 : 1j * depth.shape[1]]
    return np.where(depth > 0, depth + by * (0.5 - (u * u + v * v) / 2), 0).astype(np.float32)


def heights(points: NDArray[np.float32]) -> NDArray[np.float32]:
    return heights_and_tolerance(points, TABLE, SETTINGS, CAMERA.noise)[0]


def test_heights_are_those_above_the_plane_where_it_is_flat() -> None:
    seen = view(POSE, ROOM + THREE)
    points = back_project(seen.depth, CAMERA)
    plain = points @ TABLE[:3] + TABLE[3]
    np.testing.assert_allclose(heights(points), plain, atol=0.002)


def test_a_bent_table_is_level_and_what_stands_on_it_is_as_high_as_it_is() -> None:
    seen = view(POSE, ROOM + THREE, np.random.default_rng(0))
    true = back_project(view(POSE, ROOM + THREE).depth, CAMERA) @ TABLE[:3] + TABLE[3]
    points = back_project(bent(seen.depth, 0.02), CAMERA)
    on_table, on_things = np.abs(true) < 1e-4, (true > 0.03) & (true < 0.2)
    plain, straightened = points @ TABLE[:3] + TABLE[3], heights(points)
    assert np.quantile(np.abs(plain[on_table]), 0.9) > 0.006
    assert np.quantile(np.abs(straightened[on_table]), 0.9) < 0.004
    assert np.abs(np.median((straightened - true)[on_things])) < 0.004


def test_a_table_that_is_bent_in_waves_is_level_and_a_thin_thing_on_it_is_as_high_as_it_is() -> None:
    camera = Intrinsics(285.0, 285.0, 159.5, 119.5, 320, 240)
    v, u = np.mgrid[-1:1:240j, -1:1:320j]
    waves = 0.006 * np.cos(1.5 * np.pi * u) * np.cos(1.5 * np.pi * v)
    thing = (np.abs(u + 0.3) < 0.1) & (np.abs(v) < 0.1)
    points = back_project((1.0 - waves - 0.02 * thing).astype(np.float32), camera)
    height = heights_and_tolerance(points, np.array([0, 0, -1.0, 1.0]), SETTINGS, camera.noise)[0]
    assert np.quantile(np.abs(height[~thing]), 0.9) < 0.004
    assert np.median(height[thing]) == pytest.approx(0.02, abs=0.004)


@pytest.mark.parametrize("skipped", [(), ("bend",)])
def test_heights_are_as_much_less_certain_as_the_table_is_bent(skipped: tuple[Step, ...]) -> None:
    points = back_project(bent(view(POSE, ROOM + THREE).depth, 0.02), CAMERA)
    settings = SegmentsSettings(skipped=skipped)
    height, tolerance = heights_and_tolerance(points, TABLE, settings, CAMERA.noise)
    of_noise = noise_height(points[..., 2], TABLE, settings, CAMERA.noise)
    bend = points @ TABLE[:3].astype(np.float32) + np.float32(TABLE[3]) - height
    np.testing.assert_allclose(tolerance, of_noise + np.abs(bend) / 4, atol=1e-6)
    assert np.abs(bend).max() == 0 if skipped else np.abs(bend).max() > 0.008


@pytest.mark.parametrize("pixels", [0, 1, 99])
def test_where_little_of_the_plane_is_seen_it_is_flat(pixels: int) -> None:
    points = np.zeros((*CAMERA.shape, 3), np.float32)
    points.reshape(-1, 3)[:pixels] = POINTS.reshape(-1, 3)[-pixels - 1 : -1] if pixels else 0
    plain = points @ TABLE[:3].astype(np.float32) + np.float32(TABLE[3])
    np.testing.assert_array_equal(heights(points), plain)


def test_heights_are_numbers_where_depth_is_missing() -> None:
    points = back_project(np.zeros(CAMERA.shape, np.float32), CAMERA)
    assert np.isfinite(heights(points)).all()


@pytest.mark.parametrize(("away", "gate"), [(0.6, 3.0), (2.4, 3.0), (0.6, 6.0)])
def test_noise_lifts_what_lies_on_a_support_by_its_part_along_the_normal(away: float, gate: float) -> None:
    """Of a table that is seen aslant from afar, 0.6 m below the camera, a quarter of the noise is height."""
    noise, settings = CAMERA.noise, SETTINGS.model_copy(update={"noise_gate": gate})
    depth = np.full(1, away, np.float32)
    scatter = gate * float(noise.sigma(away))
    expected = max(settings.plane_distance, min(scatter, settings.height_min), scatter * min(1, 0.6 / away))
    assert noise_height(depth, np.array([0, -1.0, 0, 0.6]), settings)[0] == pytest.approx(expected, rel=1e-5)


def test_a_thin_thing_is_seen_on_a_table_far_away() -> None:
    """2 cm above it, by the noise of a Kinect 2.4 m away: less than three deviations along the ray."""
    assert float(CAMERA.noise.sigma(2.4)) * SETTINGS.noise_gate > 0.02
    assert noise_height(np.full(1, 2.4, np.float32), np.array([0, -0.8, -0.6, 1.0]), SETTINGS)[0] < 0.02


SMALL_TABLE = Cuboid((0, 0, -0.02), (0.7, 0.6, 0.04), colour=(180, 150, 110))
CHAIR = Cuboid((0.6, 0, -0.25), (0.05, 0.4, 0.9), colour=(1, 2, 3))
TALL = Cuboid((0.1, 0.1, 0.1), (0.1, 0.1, 0.2), colour=(4, 5, 6))


def beside(seen: View) -> NDArray[np.bool_]:
    points = back_project(seen.depth, CAMERA)
    height = (points @ TABLE[:3] + TABLE[3]).astype(np.float32)
    tolerance = noise_height(seen.depth, TABLE, SETTINGS)
    return beside_support(points, surface_normals(seen.depth, CAMERA), height, tolerance, TABLE[:3], SETTINGS)


def test_a_chair_is_beside_the_table_and_what_is_on_it_or_under_it_is_not() -> None:
    """The chair is, below the table's height and at it; above, it stands out as it is."""
    seen = view(POSE, (SMALL_TABLE, FLOOR, BACK, CHAIR, TALL))
    height = (back_project(seen.depth, CAMERA) @ TABLE[:3] + TABLE[3]).astype(np.float32)
    found, chair = beside(seen), (seen.colour == CHAIR.colour).all(-1)
    assert found[chair & (height < 0)].all()
    assert not found[chair & (height > 0.01)].any()
    for thing in (SMALL_TABLE, TALL):
        own = (seen.colour == thing.colour).all(-1)
        assert own.any()
        assert not found[own & (height < 0.01)].any(), "its edge is the table's, a foot is what stands on it"


def test_where_the_support_is_hidden_it_still_counts() -> None:
    """A thing that hides the middle of the table, down to a step in it, is beside nothing."""
    wide = Cuboid((0, 0, 0.05), (0.5, 0.4, 0.1), colour=(4, 5, 6))
    seen = view(POSE, (SMALL_TABLE, FLOOR, BACK, wide))
    sunk = (seen.colour == wide.colour).all(-1)
    points = back_project(seen.depth, CAMERA)
    height = np.where(sunk, np.float32(-0.03), points @ TABLE[:3] + TABLE[3]).astype(np.float32)
    tolerance = noise_height(seen.depth, TABLE, SETTINGS)
    found = beside_support(points, surface_normals(seen.depth, CAMERA), height, tolerance, TABLE[:3], SETTINGS)
    assert not found[sunk].any()
    assert found[(seen.colour == FLOOR.colour).all(-1)].mean() > 0.5


def test_of_a_support_that_is_not_seen_nothing_is_beside() -> None:
    assert not beside(view(look_at((0, -0.95, 0.7), (0, 3, 2.5)), ROOM)).any()


def test_a_support_that_reaches_far_is_drawn_only_where_something_is_asked_for() -> None:
    rng = np.random.default_rng(0)
    up = np.array([0, 0, 1.0])
    near, far = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32), np.float32(200)
    asked = rng.uniform(-1.5, 1.5, (500, 3)).astype(np.float32)
    inside = (np.abs(asked[:, :2]) < 1).all(axis=1)
    well = np.abs(np.abs(asked[:, :2]).max(axis=1) - 1) > 0.1  # not at the rim, which is extended
    np.testing.assert_array_equal(above_extent(asked, near, up)[well], inside[well])
    tracemalloc.start()
    assert above_extent(asked, far * near, up).all()
    assert above_extent(asked[:0], far * near, up).shape == (0,)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4e6, "not 400 m of it in cells of a centimetre"


@pytest.mark.parametrize("count", [1, 2, 3, 20, 5000])
@pytest.mark.parametrize("spread", [(0, 0), (300, 0), (100, 100), (0.1, 0.1), (300, 20)])
def test_the_hull_of_all_points_is_that_of_the_outermost(spread: tuple[float, float], count: int) -> None:
    points = np.random.default_rng(count).normal(0, spread, (count, 2)).astype(np.float32)
    outermost = _outermost(points)
    np.testing.assert_array_equal(cv2.convexHull(outermost), cv2.convexHull(points))
    assert count < 5000 or min(spread) < 20 or len(outermost) < 0.05 * count
