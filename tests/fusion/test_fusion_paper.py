"""What `paper` and `default` do with planes, registration, selection and single frames where they differ."""

from typing import Literal

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE_PAPER, ROOM, THREE, Cuboid, look_at, orbit, standing, view

from spot3d.boxes import iou_matrix_2d
from spot3d.camera import Intrinsics, back_project, invert
from spot3d.camera_pose import CameraPose
from spot3d.evaluate.frame_tables import boxes_in_frame
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import NO_SUPPORT
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.index_map import IndexMap, MatchCounts
from spot3d.fusion.map.map_arrays import COLUMNS, FREQUENCY, HEAT, WEIGHT, X
from spot3d.fusion.map.selection import frequent_points
from spot3d.fusion.objects.reasons import TOO_SMALL
from spot3d.fusion.paper.density_frame import find_by_density_in_frame
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supporting_plane import supporting_plane
from spot3d.geometry.planes import on_plane, transform_plane
from spot3d.heatmap.heat import Heatmap
from spot3d.settings import load_settings

PAPER, DEFAULT = load_settings(preset="paper").fusion, FusionSettings()
ONE = Intrinsics(100.0, 100.0, 0.0, 0.0, 1, 1)
POSE = look_at((0.0, -0.95, 0.7))


def seen_at(settings: FusionSettings, *samples: tuple[float, int]) -> tuple[Heatmap3D, list[MatchCounts]]:
    """The map of one pixel with these depths in metres and greys, one a frame."""
    heatmap, index_map, found = Heatmap3D(1000, settings.voxel), IndexMap(settings), []
    for number, (z, grey) in enumerate(samples):
        colour, heat = np.full((1, 1, 3), grey, np.uint8), np.full((1, 1), 255, np.uint8)
        depth = np.full((1, 1), z, np.float32)
        found.append(index_map.register(heatmap, number + 1, colour, depth, heat, ONE, np.eye(4)))
    return heatmap, found


def test_heat_alone_chooses_the_supporting_plane() -> None:
    points = back_project(view(POSE, ROOM).depth, CAMERA)
    table = transform_plane(np.array([0, 0, 1.0, 0]), invert(POSE))
    heat = np.where(on_plane(table, points, PAPER), 255, 0).astype(np.uint8)
    assert supporting_plane(table[None], points, heat, DEFAULT) is None, "hot all over: an object's own face"
    np.testing.assert_array_equal(supporting_plane(table[None], points, heat, PAPER), table)


def test_a_point_is_on_a_plane_within_eps_p_at_any_range() -> None:
    points = np.array([[[0, 0, 3.004], [0, 0, 3.006], [0, 0, 3.03]]], np.float32)
    plane = np.array([0, 0, -1.0, 3.0])
    assert on_plane(plane, points, PAPER).tolist() == [[True, False, False]]
    assert on_plane(plane, points, DEFAULT).tolist() == [[True, True, True]]


def test_the_plane_is_found_anew_every_ten_frames() -> None:
    fusion, rng = Fusion(PAPER), np.random.default_rng(0)
    removed = []
    for pose in orbit(21):
        seen = view(pose, ROOM + THREE, rng)
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose))
        removed.append(len(fusion.map_state().removed))
    assert removed == [1] * 10 + [2] * 10 + [3]
    table = fusion.map_state().removed
    assert (table[:, 2] > 0.99).all()
    assert (np.abs(table[:, 3]) < 0.02).all()


@pytest.mark.parametrize(("search", "points"), [("triples", 3), ("refined", 0)])
def test_planes_go_through_three_points_each_and_are_not_fitted(search: str, points: int) -> None:
    fusion = Fusion(PAPER.model_copy(update={"plane_search": search}))
    seen = view(POSE, ROOM + THREE, np.random.default_rng(0))
    fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(POSE))
    supporting = fusion.map_state().supporting
    assert supporting is not None
    plane = transform_plane(supporting, invert(POSE))
    xyz = back_project(seen.depth, CAMERA)[seen.depth > 0].astype(np.float64)
    assert np.count_nonzero(np.abs(xyz @ plane[:3] + plane[3]) < 1e-9) == points


def test_a_plane_is_found_anew_as_often_as_is_set() -> None:
    fusion, removed = Fusion(PAPER.model_copy(update={"keyframe_interval": 3})), []
    for pose in orbit(7):
        seen = view(pose, ROOM + THREE)
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose))
        removed.append(len(fusion.map_state().removed))
    assert removed == [1, 1, 1, 2, 2, 2, 3]


def test_the_pixels_that_a_keyframe_s_points_project_to_lose_their_heat() -> None:
    """A table, and half of it nearer in the next frame: the default asks each pixel whether it lies on the plane."""
    colour, heat = np.zeros((*CAMERA.shape, 3), np.uint8), np.full(CAMERA.shape, 255, np.uint8)
    table = np.full(CAMERA.shape, 1.0, np.float32)
    table[:, 120:] = 0
    later = np.full(CAMERA.shape, 1.0, np.float32)
    later[:, :40] = 0.8
    columns = {}
    for pixels in ("keyframe", "own"):
        fusion = Fusion(PAPER.model_copy(update={"plane_pixels": pixels, "plane_heat_max": 1.0}))
        for depth in (table, later):
            fusion.fuse(colour, depth, heat, CAMERA, CameraPose(np.eye(4)))
        points = fusion.heatmap.points()
        hot = points[(points[:, HEAT] > 0) & (points[:, FREQUENCY] > 0)]
        columns[pixels] = np.unique(np.rint(hot[:, X] / hot[:, X + 2] * CAMERA.fx + CAMERA.cx))
    assert columns["keyframe"].tolist() == list(range(120, 160)), "what comes into view; not what hides the table"
    assert columns["own"].tolist() == list(range(40))


def test_surfaces_are_fused_however_aslant_they_are_seen() -> None:
    """The floor 20 cm below a camera that looks straight ahead: its far part at less than 10 degrees."""
    colour, heat = np.zeros((*CAMERA.shape, 3), np.uint8), np.zeros(CAMERA.shape, np.uint8)
    depth = np.zeros(CAMERA.shape, np.float32)
    rows = np.arange(62, 120)
    depth[rows] = (0.2 * CAMERA.fy / (rows - CAMERA.cy))[:, None]
    kept = []
    for settings in (PAPER, PAPER.model_copy(update={"grazing_cos": DEFAULT.grazing_cos})):
        result = Fusion(settings).fuse(colour, depth, heat, CAMERA, CameraPose(np.eye(4)))
        kept.append((result.found + result.appended) / CAMERA.width)
    assert kept[0] == len(rows)
    assert kept[1] == pytest.approx(np.count_nonzero(rows - CAMERA.cy > np.tan(np.arcsin(0.17)) * CAMERA.fy), abs=3)


@pytest.mark.parametrize(
    ("name", "samples", "paper", "default"),
    [
        ("colour within both gates", ((1.0, 100), (1.0, 105)), 1, 1),
        ("colour beyond eps_I", ((1.0, 100), (1.0, 110)), 0, 1),
        ("depth within both gates", ((1.0, 100), (1.009, 100)), 1, 1),
        ("depth beyond eps_Z, within the noise of 2.4 m", ((2.4, 100), (2.42, 100)), 0, 1),
    ],
)
def test_the_gates_of_the_index_map(
    name: str, samples: tuple[tuple[float, int], ...], paper: int, default: int
) -> None:
    assert seen_at(PAPER, *samples)[1][1].warped == paper, name
    assert seen_at(DEFAULT, *samples)[1][1].warped == default, name


def test_means_are_plain() -> None:
    samples = (1.0, 100), (1.009, 100), (1.001, 100)
    paper, default = (seen_at(settings, *samples)[0].points()[0] for settings in (PAPER, DEFAULT))
    assert paper[X + 2] == pytest.approx(np.mean([z for z, _ in samples]), abs=1e-6)
    assert paper[WEIGHT] == paper[FREQUENCY] == 3
    assert default[X + 2] < paper[X + 2] - 1e-5, "the default weighs what is nearer more"


def test_depth_is_fused_however_far() -> None:
    assert seen_at(PAPER, (8.0, 100))[0].count == 1
    assert seen_at(DEFAULT, (8.0, 100))[0].count == 0


@pytest.mark.parametrize(("settings", "count"), [(PAPER, 640 * 480), (DEFAULT, 320 * 240)])
def test_every_pixel_is_a_point_of_its_own(settings: FusionSettings, count: int) -> None:
    camera = Intrinsics(525.0, 525.0, 319.5, 239.5, 640, 480)
    black = np.zeros((*camera.shape, 3), np.uint8)
    near = np.full(camera.shape, 1.0, np.float32)
    result = Fusion(settings).fuse(black, near, np.zeros(camera.shape, np.uint8), camera, CameraPose(np.eye(4)))
    assert result.found + result.appended == count


def test_a_surface_without_a_match_is_new_unless_a_point_lies_in_its_voxel() -> None:
    """As the paper has it, and what keeps the map bounded; the default also looks along the ray."""
    samples = (1.0, 0), (1.0, 200), (1.012, 0)
    without = PAPER.model_copy(update={"look_up": False})
    steps = [[(r.warped, r.found, r.appended) for r in seen_at(s, *samples)[1][1:]] for s in (without, PAPER)]
    assert steps[0] == [(0, 0, 1), (0, 0, 1)]
    assert steps[1] == [(0, 1, 0), (0, 0, 1)]
    assert seen_at(DEFAULT, (2.0, 0), (2.012, 200))[1][1].found == 1


def test_without_look_up_a_full_map_stays_within_its_limit() -> None:
    settings = PAPER.model_copy(update={"look_up": False, "map_limit": 30_000})
    fusion, rng = Fusion(settings), np.random.default_rng(3)
    for pose in orbit(8, turn=4.0):
        seen = view(pose, ROOM + THREE, rng)
        assert fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose)).appended > 0
        assert 0 < fusion.heatmap.count <= 30_000
    assert fusion.heatmap.evicted > 0
    assert fusion.heatmap.count == np.count_nonzero(fusion.heatmap.points()[:, FREQUENCY])


@pytest.mark.parametrize(("frames", "tau"), [(5, 10.0), (1000, 10.0)])
def test_tau_is_as_given_from_the_first_frame(frames: int, tau: float) -> None:
    rows = np.zeros((1, COLUMNS), np.float32)
    rows[:, FREQUENCY], rows[:, HEAT] = 5, 4
    assert frequent_points(rows, frames, PAPER).heat[0] == pytest.approx(4 / (5 + tau))
    assert frequent_points(rows, frames, DEFAULT).heat[0] == pytest.approx(4 / (5 + min(10.0, 0.05 * frames)))


def test_what_is_seen_too_seldom_for_where_the_camera_looked_counts_all_the_same() -> None:
    """The default wants an object seen as one in a share of the keyframes that see it; the paper has no such rule."""
    fusion, rng = Fusion(COARSE_PAPER.model_copy(update={"tau": 0.0})), np.random.default_rng(0)
    for number, pose in enumerate(orbit(60)):
        seen = view(pose, ROOM + (THREE if number < 5 else ()), rng)
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose))
    assert any(item.views < 6 for item in fusion.objects().objects)


def test_why_something_is_no_object_is_counted() -> None:
    """Clusters below the least volume; and where no plane was found nothing says where up is."""
    rng = np.random.default_rng(0)
    fusion, blind = Fusion(COARSE_PAPER.model_copy(update={"volume_min": 1.0})), Fusion(COARSE_PAPER)
    for pose in orbit(11):
        seen = view(pose, ROOM + THREE, rng)
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(pose))
        blind.fuse(seen.colour, np.zeros_like(seen.depth), seen.heat, CAMERA, CameraPose(pose))
    found, nothing = fusion.objects(), blind.objects()
    assert (found.objects, list(found.left_out)) == ([], [TOO_SMALL])
    assert (nothing.objects, nothing.left_out) == ([], {NO_SUPPORT: 2})


FINE_CAMERA = Intrinsics(450.0, 450.0, 239.5, 179.5, 480, 360)


def single(cuboids: tuple[Cuboid, ...], preset: Literal["paper", "default"], warmth: float = 1.0) -> list[list[float]]:
    """The boxes of a frame's objects, where heat is within their outlines."""
    pose = look_at((0, -1.0, 0.4))
    seen = view(pose, (*ROOM, *cuboids), np.random.default_rng(0), FINE_CAMERA)
    heat = np.where(seen.heat == 255, 255 * warmth, 0).astype(np.uint8)
    frame = RgbdFrame(0, seen.colour, np.rint(1e4 * seen.depth).astype(np.uint16), 1e-4, FINE_CAMERA, pose)
    found: list[list[float]] = boxes_in_frame(frame, Heatmap(heat, 1, 0, 0), load_settings(preset=preset)).tolist()
    return found


def test_single_frames_give_boxes_around_the_pixels_of_the_3d_boxes() -> None:
    found = single(THREE, "paper")
    outlines = []
    hit = view(look_at((0, -1.0, 0.4)), (*ROOM, *THREE), None, FINE_CAMERA).colour
    for thing in THREE:
        v, u = np.nonzero((hit == thing.colour).all(axis=-1))
        outlines.append((u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1))
    assert len(found) == 3
    assert (iou_matrix_2d(np.array(outlines), np.array(found)).max(axis=1) > 0.7).all()


def test_single_frames_join_nothing_that_is_apart() -> None:
    """A pole divides a box behind it."""
    things = standing(0.0, -0.25, (0.04, 0.04, 0.3)), standing(0.0, 0.0, (0.24, 0.08, 0.14))
    behind = np.array([[186, 139, 108, 67]])  # as it is drawn
    assert len(single(things, "paper")) == 3
    assert iou_matrix_2d(behind, np.array(single(things, "paper"))).max() < 0.5
    assert iou_matrix_2d(behind, np.array(single(things, "default"))).max() > 0.9


@pytest.mark.parametrize(("warmth", "count"), [(0.26, 3), (0.24, 0)])
def test_single_frames_judge_points_by_eps(warmth: float, count: int) -> None:
    assert len(single(THREE, "paper", warmth)) == count


def test_a_frame_without_depth_has_no_objects() -> None:
    assert find_by_density_in_frame(np.zeros(CAMERA.shape, np.float32), view(POSE, ROOM).heat, CAMERA, PAPER) == []
