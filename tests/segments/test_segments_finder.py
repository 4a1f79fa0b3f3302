"""The segments of one frame: as many as there are objects, each standing on the table."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, TABLE, THREE, Cuboid, View, look_at, standing, view
from numpy.typing import NDArray

from spot3d.boxes import iou_matrix_2d
from spot3d.camera import Intrinsics, back_project, invert
from spot3d.frame_segments import BELOW_SUPPORT, NO_SUPPORT, TOO_COLD, TOO_LONG, TOO_LOW, TOO_MANY, FrameSegments
from spot3d.geometry.downsampling import LatticeFrame
from spot3d.geometry.planes import transform_plane
from spot3d.segments.finder import _segments, candidate_planes, find_segments
from spot3d.segments.labels import pixels_of
from spot3d.segments.levels import Levels
from spot3d.segments.settings import SegmentsSettings

POSE = look_at((0, -0.95, 0.7))
FINE_CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
SETTINGS = SegmentsSettings()
BOARD = Cuboid((0.0, 0.0, 0.13), (0.2, 0.2, 0.04), colour=(200, 40, 40), heat=1.0)


def seen(*things: Cuboid, room: tuple[Cuboid, ...] = ROOM, pose: NDArray[np.float64] = POSE) -> View:
    """What a camera with noise sees; what lies on the table warms it, as proposals do that hold both."""
    found = view(pose, room + things, np.random.default_rng(0), FINE_CAMERA)
    table = (found.colour == TABLE.colour).all(-1)
    return dataclasses.replace(found, heat=np.where(table, np.maximum(found.heat, 40), found.heat).astype(np.uint8))


def on_table(height: NDArray[np.float32]) -> Levels:
    """Nothing but a table to stand on, and these heights above it."""
    table = np.array([[0, -0.6, -0.8, 0.5]])
    return Levels(table, np.zeros(height.shape, np.int8), height, np.zeros_like(height))


def find(frame: View, settings: SegmentsSettings = SETTINGS, camera: Intrinsics = FINE_CAMERA) -> FrameSegments:
    for array in (frame.colour, frame.depth, frame.heat):
        array.setflags(write=False)  # as those of messages are
    segments = find_segments(frame.colour, frame.depth, frame.heat, camera, settings)
    assert np.isfinite(segments.heat).all()
    assert np.isfinite(segments.planes).all()
    assert np.isfinite(segments.boxes(camera)).all()
    assert set(np.unique(segments.labels)) - {0} == set(range(1, len(segments) + 1)), "none is empty"
    return segments


def true_boxes(frame: View, *things: Cuboid) -> NDArray[np.float64]:
    boxes = []
    for thing in things:
        v, u = np.nonzero((frame.colour == thing.colour).all(-1))
        boxes.append((u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1))
    return np.array(boxes, np.float64)


def with_hole(frame: View, rows: slice, columns: slice) -> View:
    depth = frame.depth.copy()
    depth[rows, columns] = 0
    return dataclasses.replace(frame, depth=depth)


@pytest.mark.parametrize("width", [320, 640])
def test_every_object_is_a_segment_on_the_table(width: int) -> None:
    frame = seen(*THREE)
    segments = find(frame, SETTINGS.model_copy(update={"lattice_width": width}))
    assert (segments.camera.width, segments.camera.height) == (width, width * 3 // 4)
    assert len(segments) == 3
    assert (segments.heat > 0.5).all()
    assert set(segments.stands_on) == {0}
    table = transform_plane(segments.planes[0], POSE)
    np.testing.assert_allclose(table, [0, 0, 1, 0], atol=0.02)
    assert segments.planes[0] @ [0, 0, 0, 1] > 0, "the camera is above"
    iou = iou_matrix_2d(true_boxes(frame, *THREE), segments.boxes(FINE_CAMERA))
    assert (iou.max(axis=1) > 0.85).all()
    assert len(set(iou.argmax(axis=1))) == 3


def test_the_side_of_the_image_that_is_up_tells_which_plane_is_the_support() -> None:
    """All is warm, and there is more of the wall and the floor than of the table."""
    frame = seen(*THREE)
    heat = np.full(frame.heat.shape, 100, np.uint8)
    turned = View(*(np.ascontiguousarray(image[::-1, ::-1]) for image in (frame.colour, frame.depth, heat)))
    plane = find(turned, SETTINGS.model_copy(update={"image_up": "bottom"})).planes[0] * (-1, -1, 1, 1)
    assert transform_plane(plane, POSE)[2] > 0.99


def test_what_stands_on_the_floor_beside_the_table_is_found_as_what_is_on_the_table_is() -> None:
    table = Cuboid((0, 0, -0.02), (0.7, 0.6, 0.04), colour=TABLE.colour)
    bag = Cuboid((0.62, -0.1, -0.60), (0.25, 0.3, 0.30), 0.3, (1, 2, 3), heat=0.3)
    carton = Cuboid((-0.6, 0.1, -0.65), (0.2, 0.3, 0.20), -0.4, (4, 5, 6), heat=0.3)
    things = (THREE[1], bag, carton)
    frame = seen(*things, room=(table, *ROOM[1:]), pose=look_at((0.1, -1.3, 0.9), (0, 0, -0.25)))
    segments = find(frame)
    iou = iou_matrix_2d(true_boxes(frame, *things), segments.boxes(FINE_CAMERA))
    assert len(segments) == 3
    assert (iou.max(axis=1) > 0.8).all()
    assert segments.stands_on[iou.argmax(axis=1)].tolist() == [0, 1, 1]
    pose = look_at((0.1, -1.3, 0.9), (0, 0, -0.25))
    floor = transform_plane(segments.planes[1], pose)
    np.testing.assert_allclose(floor, [0, 0, 1, 0.75], atol=0.02)
    without = find(frame, SETTINGS.model_copy(update={"skipped": ("levels",)}))
    assert iou_matrix_2d(true_boxes(frame, bag, carton), without.boxes(FINE_CAMERA)).max(initial=0) < 0.1


@pytest.mark.parametrize(("pose", "stands_on"), [(look_at((0.0, -0.2, 1.0)), 0), (POSE, -1)])
def test_what_is_looked_down_on_stands_on_what_it_hides(pose: NDArray[np.float64], stands_on: int) -> None:
    """As a ball does, of which the upper half is seen; beneath a board in the air the table is seen from the side."""
    assert find(seen(BOARD, pose=pose)).stands_on.tolist() == [stands_on]


def test_what_is_looked_down_on_does_not_stand_beneath_what_carries_it() -> None:
    """The table is nowhere seen beside it, but what it stands on."""
    carton = standing(0.0, 0.0, (0.3, 0.3, 0.11), colour=(40, 160, 60))
    segments = find(seen(BOARD, carton, pose=look_at((0.0, -0.2, 1.0))))
    assert segments.stands_on.tolist() == [0, -1]


def test_the_same_frame_gives_the_same_segments() -> None:
    first, second = find(seen(*THREE)), find(seen(*THREE))
    np.testing.assert_array_equal(first.labels, second.labels)
    np.testing.assert_array_equal(first.planes, second.planes)
    np.testing.assert_array_equal(first.heat, second.heat)


def test_a_camera_that_hangs_upside_down_finds_the_same() -> None:
    upright = seen(*THREE)
    turned = View(*(np.ascontiguousarray(image[::-1, ::-1]) for image in (upright.colour, upright.depth, upright.heat)))
    segments = find(turned, SETTINGS.model_copy(update={"image_up": "bottom"}))
    true = true_boxes(turned, *THREE)
    assert (iou_matrix_2d(true, segments.boxes(FINE_CAMERA)).max(axis=1) > 0.85).all()
    assert len(segments) == 3


@pytest.mark.parametrize("tilt", [-2.0, 0.0, 2.0])
def test_a_camera_straight_above_the_table_finds_the_same(tilt: float) -> None:
    """Though a carton's side faces the upper side of the image, and the table does not; tilt: degrees."""
    sine, cosine = np.sin(np.radians(tilt)), np.cos(np.radians(tilt))
    pose = np.array([[1.0, 0, 0, 0], [0, -cosine, sine, -sine], [0, -sine, -cosine, cosine], [0, 0, 0, 1]])
    things = (standing(-0.05, -0.25, (0.3, 0.15, 0.2), colour=(50, 60, 200)), *THREE[:2])
    frame = seen(*things, pose=pose)
    segments = find(frame)
    assert len(segments) == 3
    assert (iou_matrix_2d(true_boxes(frame, *things), segments.boxes(FINE_CAMERA)).max(axis=1) > 0.85).all()


@pytest.mark.parametrize("tall", [0.06, 0.1, 0.15])
def test_what_stands_on_a_book_is_its_own_seen_from_straight_above(tall: float) -> None:
    """Its sides, and whether they reach down to the book, are hidden by its top."""
    book = standing(0, 0, (0.2, 0.25, 0.03))
    thing = Cuboid((0.02, 0, 0.03 + tall / 2), (0.1, 0.1, tall), 0.3, (40, 160, 60), heat=1.0)
    pose = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.1], [0, 0, 0, 1]])
    frame = seen(book, thing, pose=pose)
    segments = find(frame)
    assert len(segments) == 2
    iou = iou_matrix_2d(true_boxes(frame, book, thing), segments.boxes(FINE_CAMERA))
    assert (iou.max(axis=1) > 0.8).all()


@pytest.mark.parametrize("value", [0.0, 5.0])
def test_without_depth_within_range_there_is_nothing(value: float) -> None:
    blank = np.zeros(CAMERA.shape, np.uint8)
    frame = View(np.zeros((*CAMERA.shape, 3), np.uint8), np.full(CAMERA.shape, value, np.float32), blank + 255)
    segments = find(frame, camera=CAMERA)
    assert (len(segments), segments.labels.any()) == (0, False)


def test_where_there_is_no_plane_there_is_nothing() -> None:
    depth = np.zeros(CAMERA.shape, np.float32)
    depth[50] = 1.0  # a single line
    warm = np.full(CAMERA.shape, 255, np.uint8)
    segments = find(View(np.zeros((*CAMERA.shape, 3), np.uint8), depth, warm), camera=CAMERA)
    assert (len(segments), len(segments.planes)) == (0, 0)


def test_where_nothing_is_warm_there_is_nothing() -> None:
    frame = seen(*THREE)
    cold = dataclasses.replace(frame, heat=np.zeros_like(frame.heat))
    assert len(find(cold)) == 0


def test_a_bare_table_has_no_objects_though_it_shines_and_is_bent() -> None:
    frame = seen()
    v, u = np.mgrid[-1:1:480j, -1:1:640j]
    rng = np.random.default_rng(1)
    depth = np.where(frame.depth > 0, frame.depth + 0.012 * (0.5 - (u * u + v * v) / 2), 0).astype(np.float32)
    glare = (np.hypot(u - 0.2, 0.75 * v) < 0.12) & (rng.random(depth.shape) < 0.9)
    depth[glare] = 0
    specks = rng.random(depth.shape) < 0.001
    depth[specks] -= 0.05
    warm = np.full_like(frame.heat, 60)
    assert len(find(View(frame.colour, np.maximum(depth, 0), warm))) == 0


def test_a_swell_of_the_support_without_an_edge_is_no_object() -> None:
    """Sensors bend depth so in a corner of the image, more steeply than a quadratic does."""
    frame = seen()
    points = back_project(frame.depth, FINE_CAMERA)
    plane = transform_plane(np.array([0, 0, 1.0, 0]), invert(POSE))
    on_table = (frame.colour == TABLE.colour).all(-1)
    middle = points[on_table].mean(axis=0)
    for across, expected in ((0.05, 0), (0.01, 1)):
        swell = 0.02 * np.exp(-0.5 * (np.linalg.norm(points - middle, axis=2) / across) ** 2 * (across > 0.02))
        swell *= np.linalg.norm(points - middle, axis=2) < 4 * across
        depth = (frame.depth * np.where(on_table, 1 - swell / plane[3], 1)).astype(np.float32)
        warm = np.full_like(frame.heat, 60)
        assert len(find(View(frame.colour, depth, warm))) == expected


@pytest.mark.parametrize("tall", [0.015, 0.03])
def test_a_thin_thing_on_the_table_counts(tall: float) -> None:
    book = standing(0, 0, (0.2, 0.14, tall))
    frame = seen(book)
    segments = find(frame)
    assert len(segments) == 1
    assert iou_matrix_2d(true_boxes(frame, book), segments.boxes(FINE_CAMERA))[0, 0] > 0.7


def test_a_wall_is_no_object_however_warm() -> None:
    """A partition on the table, longer than eps_max."""
    partition = standing(0, 0.3, (1.3, 0.03, 0.7), colour=(1, 2, 3))
    frame = seen(*THREE, partition)
    segments = find(frame)
    iou = iou_matrix_2d(true_boxes(frame, *THREE), segments.boxes(FINE_CAMERA))
    assert len(segments) == 3
    assert (iou.max(axis=1) > 0.8).all()


def test_a_chair_at_the_table_is_not_cut_where_the_table_is_high() -> None:
    small, chair = Cuboid((0, 0, -0.02), (0.7, 0.6, 0.04), colour=TABLE.colour), standing(0.6, 0, (0.05, 0.4, 0.9))
    chair = dataclasses.replace(chair, centre=(0.6, 0, -0.25), colour=(1, 2, 3))
    frame = seen(*THREE[:2], chair, room=(small, *ROOM[1:]), pose=look_at((0.1, -1.3, 0.8), (0.2, 0, -0.1)))
    segments = find(frame)
    iou = iou_matrix_2d(true_boxes(frame, *THREE[:2], chair), segments.boxes(FINE_CAMERA))
    assert len(segments) == 3
    assert (iou.max(axis=1) > 0.8).all()
    assert segments.stands_on[iou.argmax(axis=1)].tolist() == [0, 0, 1]
    without = find(frame, SETTINGS.model_copy(update={"skipped": ("beside",)})).boxes(FINE_CAMERA)
    assert iou_matrix_2d(true_boxes(frame, chair), without).max() < 0.5


def test_what_is_no_segment_is_counted_by_reason() -> None:
    longer = find(seen(standing(0, 0, (0.3, 0.3, 0.3))), SETTINGS.model_copy(update={"size_max": 0.35}))
    low = find(seen(standing(0, 0, (0.2, 0.14, 0.03))), SETTINGS.model_copy(update={"height_min": 0.05}))
    frame = seen(*THREE)
    cold = find(dataclasses.replace(frame, heat=frame.heat // 2), SETTINGS.model_copy(update={"heat_min": 1.0}))
    assert (len(cold), cold.left_out[TOO_COLD]) == (0, 3)
    assert (len(longer), longer.left_out[TOO_LONG]) == (0, 1)
    assert (len(low), low.left_out[TOO_LOW]) == (0, 1)


def test_what_rises_nowhere_above_the_support_is_counted_if_it_may_be_an_object() -> None:
    """A stool at the table, on which nothing is known to stand; and a pencil there."""
    small, without = (
        Cuboid((0, 0, -0.02), (0.7, 0.6, 0.04), colour=TABLE.colour),
        SETTINGS.model_copy(update={"skipped": ("levels",)}),
    )
    for thing, count in ((Cuboid((0.6, 0, -0.4), (0.3, 0.3, 0.7)), 1), (Cuboid((0.6, 0, -0.74), (0.1, 0.01, 0.02)), 0)):
        frame = seen(*THREE[:2], thing, room=(small, *ROOM[1:]), pose=look_at((0.1, -1.3, 0.8), (0.2, 0, -0.1)))
        segments = find(frame, without)
        assert (len(segments), segments.left_out.get(BELOW_SUPPORT, 0)) == (2, count)


def test_a_frame_without_a_support_says_so() -> None:
    frame = seen(*THREE)
    nothing = find(dataclasses.replace(frame, depth=np.zeros_like(frame.depth)))
    assert (len(nothing), nothing.left_out) == (0, {NO_SUPPORT: 1})


def test_two_boxes_that_touch_are_two() -> None:
    things = standing(0, 0, (0.14, 0.1, 0.12), colour=(200, 40, 40)), standing(-0.05, -0.1, (0.2, 0.1, 0.05))
    assert len(find(seen(*things))) == 2


@pytest.mark.parametrize("x", [-0.05, 0.08])
def test_what_is_in_an_open_box_is_a_segment_of_its_own(x: float) -> None:
    walls = [standing(0, y, (0.4, 0.01, 0.12)) for y in (-0.15, 0.15)]
    walls += [standing(side, 0, (0.01, 0.3, 0.12)) for side in (-0.2, 0.2)]
    crate = [dataclasses.replace(wall, colour=(50, 60, 200)) for wall in (standing(0, 0, (0.4, 0.3, 0.01)), *walls)]
    content = standing(x, 0.02, (0.1, 0.1, 0.08))
    frame = seen(*crate, content)
    segments = find(frame)
    assert len(segments) == 2
    iou = iou_matrix_2d(true_boxes(frame, crate[0], content)[1:], segments.boxes(FINE_CAMERA))
    assert iou.max() > 0.8


@pytest.mark.parametrize("eye", [(0, -0.5, 1.0), (0, 0, 1.1)])
@pytest.mark.parametrize("tall", [0.08, 0.11])
def test_what_is_in_a_bin_is_found_from_steeply_above(tall: float, eye: tuple[float, float, float]) -> None:
    """Whatever the bin itself comes to, of which the rim and the floor are all that is seen from straight above."""
    walls = [standing(0, y, (0.4, 0.01, 0.14)) for y in (-0.15, 0.15)]
    walls += [standing(x, 0, (0.01, 0.3, 0.14)) for x in (-0.2, 0.2)]
    crate = [dataclasses.replace(wall, colour=(50, 60, 200)) for wall in (standing(0, 0, (0.4, 0.3, 0.01)), *walls)]
    contents = (
        standing(-0.1, 0.05, (0.1, 0.08, tall), 0.3),
        standing(0.08, -0.03, (0.08, 0.12, tall), -0.5, (40, 160, 60)),
        standing(-0.08, -0.08, (0.12, 0.06, tall), 0.0, (180, 160, 60)),
    )
    straight = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.1], [0, 0, 0, 1]])
    frame = seen(*crate, *contents, pose=straight if eye[1] == 0 else look_at(eye))
    iou = iou_matrix_2d(true_boxes(frame, *contents), find(frame).boxes(FINE_CAMERA))
    assert (iou.max(axis=1) > 0.8).all()


@pytest.mark.parametrize("width", [8, 20])
def test_a_hole_that_tears_an_object_is_a_part_of_it(width: int) -> None:
    carton = standing(0, 0, (0.24, 0.08, 0.16))
    frame = with_hole(seen(carton), slice(None), slice(320 - width // 2, 320 + width // 2))
    segments = find(frame)
    assert len(segments) == 1
    assert iou_matrix_2d(true_boxes(frame, carton), segments.boxes(FINE_CAMERA))[0, 0] > 0.85
    on_carton = (frame.colour == carton.colour).all(-1)[::2, ::2]
    hole = (frame.depth == 0)[::2, ::2]
    assert segments.labels[on_carton & hole].mean() > 0.8
    assert segments.labels[~on_carton & hole].mean() < 0.1


def test_a_hole_of_the_table_is_no_part_of_what_stands_beside_it() -> None:
    carton = standing(0, 0, (0.2, 0.08, 0.16))
    frame = seen(carton)
    x, y, w, h = true_boxes(frame, carton)[0].astype(int)
    segments = find(with_hole(frame, slice(y + h // 2, y + h), slice(x + w, x + w + 60)))
    np.testing.assert_allclose(segments.boxes(FINE_CAMERA), [[x, y, w, h]], atol=8)


def test_without_depth_behind_the_objects_they_are_no_larger() -> None:
    """What is out of the sensor's range has no depth, and may be of any colour."""
    low = look_at((0, -0.9, 0.6), (0, 0, 0.15))
    things = tuple(dataclasses.replace(thing, colour=(*thing.colour[:2], 10 + k)) for k, thing in enumerate(THREE))
    frame = seen(*things, room=(TABLE,), pose=low)
    assert not frame.depth[:20].any()
    sky = np.where((frame.depth == 0)[..., None], np.array(things[1].colour) // 2 + 40, frame.colour)
    boxes = find(dataclasses.replace(frame, colour=sky.astype(np.uint8))).boxes(FINE_CAMERA)
    assert (iou_matrix_2d(true_boxes(frame, *things), boxes).max(axis=1) > 0.75).all()


def test_what_something_in_front_divides_is_one() -> None:
    carton, post = standing(0, 0.1, (0.3, 0.08, 0.16), colour=(9, 99, 9)), standing(0, -0.15, (0.05, 0.05, 0.35))
    frame = seen(carton, post)
    segments = find(frame)
    assert len(segments) == 2
    assert (iou_matrix_2d(true_boxes(frame, carton, post), segments.boxes(FINE_CAMERA)).max(axis=1) > 0.8).all()


def test_a_cup_on_a_long_shelf_is_no_part_of_the_box_beneath_it() -> None:
    shelf = Cuboid((0, 0.32, 0.23), (1.3, 0.26, 0.02), colour=(3, 4, 5))
    cup = Cuboid((0.0, 0.33, 0.29), (0.1, 0.1, 0.1), colour=(200, 40, 40), heat=1.0)
    carton = standing(0.0, 0.25, (0.16, 0.12, 0.15), colour=(40, 160, 60))
    frame = seen(cup, carton, room=(*ROOM, shelf), pose=look_at((0, -0.7, 0.5), (0, 0.3, 0.18)))
    segments = find(frame)
    assert len(segments) == 2
    assert (iou_matrix_2d(true_boxes(frame, cup, carton), segments.boxes(FINE_CAMERA)).max(axis=1) > 0.85).all()


def test_what_lies_beyond_the_range_is_not_looked_for() -> None:
    near = SETTINGS.model_copy(update={"range_max": 1.1})
    frame = seen(*THREE)
    behind = frame.depth.reshape(240, 2, 320, 2).min(axis=(1, 3)) > 1.15
    segments = find(frame, near)
    assert 0 < len(segments) <= 3
    assert not segments.labels[behind].any()


def test_of_more_objects_than_a_message_takes_the_largest_are_kept() -> None:
    camera = Intrinsics(600.0, 600.0, 159.5, 119.5, 320, 240)
    labels = np.arange(240 // 8 * (320 // 8)).reshape(30, 40).repeat(8, axis=0).repeat(8, axis=1).astype(np.int32)
    parts = pixels_of(labels)[:300]
    parts[7] = parts[7][:50]
    depth = np.ones(camera.shape, np.float32)
    colour, heat = np.zeros((*camera.shape, 3), np.uint8), np.full(camera.shape, 100, np.uint8)
    height = np.full(depth.size, 0.01, np.float32)
    frame = LatticeFrame(colour, depth, heat, camera)
    segments = _segments(parts, frame, candidate_planes(frame, SETTINGS), on_table(height), Counter(), SETTINGS)
    assert (len(segments), segments.left_out) == (255, {TOO_MANY: 45})
    assert np.unique(segments.labels).tolist() == list(range(256))
    assert not segments.labels.ravel()[parts[7]].any()


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        ([[-1, -1], [-1, -1]], []),
        ([[0, 1], [1, 0]], [[0, 3], [1, 2]]),
        ([[-1, 2], [0, 2]], [[2], [1, 3]]),
    ],
)
def test_pixels_of_each_label(labels: list[list[int]], expected: list[list[int]]) -> None:
    assert [pixels.tolist() for pixels in pixels_of(np.array(labels, np.int32))] == expected


def test_planes_are_those_of_the_camera() -> None:
    segments = find(seen(*THREE))
    assert transform_plane(np.array([0, 0, 1.0, 0]), invert(POSE)) @ segments.planes[0] > 0.9
