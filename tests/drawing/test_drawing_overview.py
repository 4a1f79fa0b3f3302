import itertools

import cv2
import numpy as np
import pytest

from spot3d.boxes import Box3D, corners
from spot3d.camera import Intrinsics, back_project
from spot3d.drawing.box_views import choose_views, draw_view, visibility
from spot3d.drawing.overview import candidate_indices, draw_overview
from spot3d.drawing.picture import draw_text, object_colour, place_labels, write_picture
from spot3d.found_object import FoundObject
from spot3d.frame import RgbdFrame

CAMERA = Intrinsics(100.0, 100.0, 80.0, 60.0, 160, 120)
UP = np.array([0.0, -1.0, 0.0])


def cube(x: float, z: float = 2.0, side: float = 0.4) -> Box3D:
    return Box3D(np.array([x, 0.0, z]), np.full(3, side), np.eye(3))


def frame(depth: float = 3.0) -> RgbdFrame:
    colour = np.full((120, 160, 3), 90, np.uint8)
    return RgbdFrame(0, colour, np.full((120, 160), depth, np.float32), 1.0, CAMERA)


def moved(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


@pytest.mark.parametrize(
    ("box", "depth", "expected"),
    [
        (cube(0.0), None, 1.0),
        (cube(0.0), 3.0, 1.0),
        (cube(0.0), 1.0, 0.0),  # something stands in front
        (cube(9.0), None, 0.0),  # outside of the picture
        (cube(0.0, z=-2.0), None, 0.0),  # behind the camera
    ],
)
def test_visibility(box, depth, expected):
    image = None if depth is None else np.full(CAMERA.shape, depth, np.float32)
    assert visibility([box], np.eye(4), CAMERA, image)[0] == pytest.approx(expected)


def test_visibility_of_nothing():
    assert visibility([], np.eye(4), CAMERA).shape == (0,)


def test_a_small_box_is_seen_less_well():
    scores = visibility([cube(0.0, side=0.4), cube(0.0, side=0.05)], np.eye(4), CAMERA)
    assert scores[0] > 2 * scores[1] > 0


@pytest.mark.parametrize(
    ("scores", "count", "expected"),
    [
        (np.zeros((0, 0)), 3, []),
        (np.zeros((2, 0)), 3, [0, 1]),
        (np.array([[1.0, 0], [0, 0], [0, 1.0], [0, 0]]), 2, [0, 2]),
        (np.array([[0.6, 0.6], [1.0, 0], [0, 0]]), 1, [0]),
    ],
)
def test_choose_views(scores, count, expected):
    assert choose_views(scores, count) == expected


def test_labels_do_not_overlap():
    places = place_labels([(50, 50)] * 4, [20] * 4, 10, (200, 200))
    bottoms = sorted(bottom for _, bottom in places)
    assert all(below - above >= 10 for above, below in itertools.pairwise(bottoms))


def test_colours_differ():
    assert len({object_colour(number) for number in range(1, 40)}) == 39


def test_corners():
    points = corners(cube(1.0))
    np.testing.assert_allclose(points.min(axis=0), (0.8, -0.2, 1.8))
    np.testing.assert_allclose(points.max(axis=0), (1.2, 0.2, 2.2))


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_candidates_are_spread(count):
    indices = candidate_indices(count)
    assert len(indices) == min(count, 40)
    assert indices == sorted(set(indices))
    assert not count or (indices[0] == 0 and indices[-1] == count - 1)


def test_overview_shows_boxes_in_views_and_from_above(tmp_path):
    points = back_project(frame().depth_metres(), CAMERA).reshape(-1, 3)
    rgb = np.full((len(points), 3), 120, np.uint8)
    views = [(frame(), moved(x)) for x in (0.0, 0.3, 0.6)]
    path = np.array([pose[:3, 3] for _, pose in views])
    objects = [FoundObject(1, cube(-0.4), 0.5, 3, 100), FoundObject(2, cube(0.6), 0.9, 3, 100)]
    bare = draw_overview("none", views, [], points, rgb, path, UP)
    picture = draw_overview("two", views, objects, points, rgb, path, UP)
    assert picture.shape[1] == 1600
    view_bottom = 46 + picture.shape[0] - 46 - 700 - 20
    for item in objects:
        painted = np.abs(picture.astype(int) - object_colour(item.id)).max(axis=2) < 12
        for column in range(3):
            view = painted[:view_bottom, 10 + column * 530 : 530 + column * 530]
            assert view.sum() > 100, "each view shows each box"
        assert painted[view_bottom + 20 :, :1050].sum() > 200, "and so does the view from above"
    assert (bare != picture).any()
    write_picture(tmp_path / "overview.png", picture)
    read = cv2.imread(str(tmp_path / "overview.png"))
    np.testing.assert_array_equal(read[..., ::-1], picture)


def test_overview_of_a_run_that_fused_nothing():
    xyz, rgb = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
    picture = draw_overview("empty", [], [], xyz, rgb, np.zeros((0, 3)), UP)
    assert picture.shape[1] == 1600
    assert picture.std() > 1


def test_a_pose_that_is_far_away_leaves_the_view_from_above_as_it_is():
    """Any finite pose is a valid message; fusion uses none beyond 2 km."""
    xyz, rgb = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    far = np.array([[0.0, 0.0, 1e100], [0.0, -1e300, 0.0], [2001.0, 0.0, 0.0]])
    objects = [FoundObject(1, cube(0.4), 0.5, 3, 100)]
    without, with_far = (draw_overview("far", [], objects, xyz, rgb, way, UP) for way in (path, np.vstack((far, path))))
    np.testing.assert_array_equal(without, with_far)
    assert draw_overview("far", [], objects, xyz, rgb, far, UP).any(), "the box is drawn without any path"


def test_a_text_that_no_font_has_is_drawn_as_far_as_it_can_be() -> None:
    """OpenCV ends the process where a text is not UTF-8."""
    picture = np.zeros((40, 200, 3), np.uint8)
    draw_text(picture, "caf\udce9 \u65e5", (5, 30))
    assert picture.any()


def test_the_list_calls_views_what_objects_json_calls_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are keyframes: a run of 300 frames has some thirty."""
    texts: list[str] = []

    def noted(picture: np.ndarray, text: str, *arguments: object, **named: object) -> None:
        texts.append(text)

    monkeypatch.setattr("spot3d.drawing.overview.draw_text", noted)
    xyz, rgb = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
    objects = [FoundObject(1, cube(0.0), 0.5, 28, 345)]
    draw_overview("kitchen", [], objects, xyz, rgb, np.zeros((0, 3)), UP)
    assert "views" in texts
    assert "frames" not in texts


@pytest.mark.parametrize(
    ("shape", "drawn", "columns"),
    [((120, 160), (75, 100), 100), ((300, 60), (400, 100), 80), ((2000, 1), (400, 100), 1), ((1, 8192), (1, 100), 100)],
)
def test_the_picture_of_a_sliver_is_no_larger_than_a_screen(
    shape: tuple[int, int], drawn: tuple[int, int], columns: int
) -> None:
    """Any image that the contract allows becomes a picture; a narrow one is whole, with black beside it."""
    sliver = RgbdFrame(
        0,
        np.full((*shape, 3), 90, np.uint8),
        np.zeros(shape, np.uint16),
        1.0,
        Intrinsics(100.0, 100.0, 0.0, 0.0, shape[1], shape[0]),
    )
    picture = draw_view(sliver, np.eye(4), (), 100)
    assert picture.shape == (*drawn, 3)
    assert (picture[:, :columns] == 90).all()
    assert not picture[:, columns:].any()
