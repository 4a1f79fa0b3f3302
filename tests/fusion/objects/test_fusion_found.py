"""Boxes from what several views saw of one thing."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import rotation_z
from numpy.typing import NDArray

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.fusion.objects.found import ObjectViews, box_of, ends_of
from spot3d.fusion.objects.outline import OUTERMOST
from spot3d.fusion.objects.views import SAMPLE

UP = np.array([0.0, 0.0, 1.0])
TABLE = np.array([0.0, 0.0, 1.0, 0.0])
SIZE = np.array([0.2, 0.1, 0.12])


def segment(rng: np.random.Generator, low: float = 0.0, high: float = 0.12, yaw: float = 0.4) -> NDArray[np.float32]:
    """SAMPLE points on the sides and top of a box on the table, from a height to another."""
    points = rng.uniform(-0.5, 0.5, (SAMPLE, 3)) * SIZE
    side = np.arange(SAMPLE) % 5
    points[side == 0, 0], points[side == 1, 0] = -0.1, 0.1
    points[side == 2, 1], points[side == 3, 1] = -0.05, 0.05
    points[side == 4, 2] = 0.06
    points[:, 2] = np.clip(points[:, 2] + 0.06, low, high)
    return (points @ rotation_z(yaw).T).astype(np.float32)


def seen(
    places: list[NDArray[np.float32]],
    support: NDArray[np.float64] = TABLE,
    frame: list[int] | None = None,
    blur: tuple[float, float, float] = (0, 0, 0),
) -> ObjectViews:
    frames = np.arange(len(places)) if frame is None else np.array(frame)
    blurs = np.tile(np.float32(blur), (len(places), 1))
    outline = np.full((len(places), OUTERMOST, 3), np.nan, np.float32)
    supports, eyes = np.broadcast_to(support, (len(places), 4)), np.tile((1.0, 0.0, 0.5), (len(places), 1))
    return ObjectViews(np.array(places), outline, blurs, supports, frames, eyes)


def true_box(yaw: float = 0.4) -> Box3D:
    return Box3D(np.array([0, 0, 0.06]), SIZE, rotation_z(yaw))


def overlap(box: Box3D, yaw: float = 0.4) -> float:
    return float(iou_matrix_3d([true_box(yaw)], [box])[0, 0])


def bottom(box: Box3D) -> float:
    return float(box.centre[2] - box.size[2] / 2)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2])
def test_a_box_is_as_large_as_what_was_seen(yaw: float) -> None:
    rng = np.random.default_rng(0)
    box = box_of(seen([segment(rng, yaw=yaw) for _ in range(6)]), UP, 0.005)
    assert overlap(box, yaw) > 0.85
    assert bottom(box) == pytest.approx(0.005, abs=1e-6)


def test_a_view_that_is_off_moves_no_face() -> None:
    rng = np.random.default_rng(0)
    places = [segment(rng) for _ in range(20)]
    straight = box_of(seen(places), UP, 0.005)
    places[7] = places[7] + np.float32(0.05)
    moved = box_of(seen(places), UP, 0.005)
    assert overlap(moved) > overlap(straight) - 0.1


def test_noise_along_the_ray_makes_no_box_larger() -> None:
    """From 2.5 m, where a Kinect's depth scatters by a centimetre."""
    rng = np.random.default_rng(0)
    ray, sigma = np.array((0.6, 0.0, -0.8)), 0.01
    places = [(segment(rng, yaw=0) + rng.normal(0, sigma, (SAMPLE, 1)) * ray).astype(np.float32) for _ in range(20)]
    x, y, z = sigma * ray
    plain, known = box_of(seen(places), UP, 0.005), box_of(seen(places, blur=(x, y, z)), UP, 0.005)
    assert overlap(known, 0) > overlap(plain, 0) + 0.05
    assert (known.size > SIZE - 0.01).all()


def test_points_that_fly_off_move_no_face() -> None:
    rng = np.random.default_rng(0)
    places = [segment(rng) for _ in range(5)]
    for place in places:
        place[:2] += (0.0, 0.0, 0.4)
    assert overlap(box_of(seen(places), UP, 0.005)) > 0.8


@pytest.mark.parametrize(("hidden", "expected"), [(0.03, 0.005), (0.08, 0.08)])
def test_a_hidden_bottom_is_on_the_support_if_that_is_near(hidden: float, expected: float) -> None:
    rng = np.random.default_rng(0)
    places = [segment(rng, low=hidden) for _ in range(5)]
    assert bottom(box_of(seen(places), UP, 0.005)) == pytest.approx(expected, abs=2e-3)


def test_a_bottom_that_is_hidden_from_above_is_on_the_support() -> None:
    """Of a ball the upper half is seen from above."""
    rng = np.random.default_rng(0)
    aside = seen([segment(rng, low=0.08) for _ in range(5)])
    for above, expected in ((3, 0.005), (2, 0.08)):
        eyes = np.array([(0.1, 0.2, 1.0)] * above + [(1.0, 0.0, 0.5)] * (5 - above))
        box = box_of(replace(aside, eyes=eyes), UP, 0.005)
        assert bottom(box) == pytest.approx(expected, abs=2e-3), above


def test_what_stands_on_nothing_known_ends_where_it_ends() -> None:
    rng = np.random.default_rng(0)
    box = box_of(seen([segment(rng, low=0.03) for _ in range(5)], np.zeros(4)), UP, 0.005)
    assert bottom(box) == pytest.approx(0.03, abs=2e-3)


def test_most_of_its_segments_say_what_it_stands_on() -> None:
    rng = np.random.default_rng(0)
    places = [segment(rng, low=0.02) for _ in range(5)]
    support = np.array([TABLE, TABLE, np.zeros(4), np.zeros(4), np.zeros(4)])
    assert bottom(box_of(seen(places, support), UP, 0.0)) == pytest.approx(0.02, abs=2e-3)
    support[2] = TABLE
    assert bottom(box_of(seen(places, support), UP, 0.0)) == pytest.approx(0.0, abs=1e-9)


def test_flat_things_keep_their_height() -> None:
    rng = np.random.default_rng(0)
    box = box_of(seen([segment(rng, high=0.01) for _ in range(5)]), UP, 0.005)
    assert box.size[2] == pytest.approx(0.85 * 0.01, abs=1e-3)


def test_parts_of_one_view_count_as_one_view() -> None:
    """A view that tore a thing in two says how far both reach, together."""
    rng = np.random.default_rng(0)
    places, frames = [], []
    for frame in range(6):
        whole = segment(rng)
        left = (whole @ rotation_z(0.4))[:, 0] < 0
        for half in (whole[left], whole[~left]):
            places.append(half[np.linspace(0, len(half) - 1, SAMPLE).astype(int)])
            frames.append(frame)
    assert overlap(box_of(seen(places, frame=frames), UP, 0.005)) > 0.85


def test_a_single_point_is_a_box_without_a_hole() -> None:
    box = box_of(seen([np.ones((SAMPLE, 3), np.float32)], np.zeros(4)), UP, 0.005)
    assert np.isfinite(box.centre).all()
    assert (box.size > 0).all()


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2])
def test_a_view_that_spills_turns_no_box(yaw: float) -> None:
    """Over two opposite corners: the smallest rectangle around all points lies along that diagonal."""
    rng = np.random.default_rng(0)
    places = [segment(rng, yaw=yaw) for _ in range(30)]
    spilled = rng.uniform((0.10, 0.08, 0.0), (0.16, 0.12, 0.03), (40, 3))
    spilled[::2, :2] *= -1
    places[11][::5] = spilled @ rotation_z(yaw).T
    assert overlap(box_of(seen(places), UP, 0.005), yaw) > 0.85


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2])
def test_two_sides_tell_how_a_box_is_turned(yaw: float) -> None:
    """The front and one end of a thing whose top is out of sight: along the line from end to end a box is as small."""
    rng = np.random.default_rng(0)
    places = []
    for _ in range(12):
        sides = rng.uniform((-0.1, -0.05, 0), (0.1, 0.05, 0.12), (SAMPLE, 3))
        sides[::3, 0], sides[1::3, 1], sides[2::3, 1] = 0.1, 0.05, 0.05
        places.append(((sides + rng.normal(0, 0.002, sides.shape)) @ rotation_z(yaw).T).astype(np.float32))
    assert overlap(box_of(seen(places), UP, 0.005), yaw) > 0.85


def test_views_that_take_in_what_is_behind_make_nothing_thicker() -> None:
    """As three of thirty views do of a book, by five points that lie 3 cm above it."""
    rng = np.random.default_rng(0)
    places = [segment(rng, high=0.03) for _ in range(30)]
    for number in (3, 14, 25):
        places[number][:5, 2] = 0.06
    assert box_of(seen(places), UP, 0.005).size[2] == pytest.approx(0.03, abs=0.003)


def test_a_view_ends_where_two_places_of_each_segment_lie_beyond() -> None:
    rng = np.random.default_rng(0)
    along = rng.normal(size=(20, SAMPLE, 3)).round(1).astype(np.float32)
    lows, highs = ends_of(seen(list(along), frame=[k // 2 for k in range(20)], blur=(0.25, 0, 0)), np.eye(3))
    ordered, scatter = np.sort(along, axis=1), np.array((0.25, 0, 0))
    np.testing.assert_array_equal(lows.T, ordered[:, 2].reshape(10, 2, 3).min(axis=1) + scatter)
    np.testing.assert_array_equal(highs.T, ordered[:, -3].reshape(10, 2, 3).max(axis=1) - scatter)


def test_what_is_known_of_a_segment_stays_with_its_places() -> None:
    rows = np.arange(3)
    several = ObjectViews(
        *(
            np.full((3, *shape), rows.reshape(3, *[1] * len(shape)))
            for shape in ((SAMPLE, 3), (OUTERMOST, 3), (3,), (4,))
        ),
        rows,
        np.full((3, 3), rows[:, None]),
    )
    kept = several.with_places(10 + several.places, np.array([True, False, True]))
    for name, values in vars_of(kept).items():
        expected = [10, 12] if name == "places" else [0, 2]
        assert values.reshape(2, -1)[:, 0].tolist() == expected, name


def vars_of(item: ObjectViews) -> dict[str, NDArray[np.float64]]:
    return {field: getattr(item, field) for field in item.__slots__}
