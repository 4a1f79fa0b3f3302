"""From map points to objects: found whole, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import BACKDROP_PLANE, COARSE, COARSE_PAPER, FINE, STAGE, TABLE_PLANE, THREE, Cuboid, sampled, standing

from spot3d.boxes import iou_matrix_3d
from spot3d.evaluate.points import points_in_boxes
from spot3d.fusion.density import find_by_density
from spot3d.fusion.extraction import find_objects
from spot3d.fusion.selection import MapPoints
from spot3d.fusion.settings import FusionSettings

PLANES = [TABLE_PLANE, BACKDROP_PLANE]
LARGE = standing(0.10, 0.0, (0.20, 0.26, 0.20), colour=(0, 200, 0))
FACE_TO_FACE = (standing(-0.05, 0.0, (0.10, 0.10, 0.10)), LARGE)
EDGE_TO_FACE = (standing(-0.07, 0.0, (0.10, 0.10, 0.10), 0.785), LARGE)
STACKED = (
    standing(0, 0, (0.24, 0.24, 0.10), 0.4, colour=(0, 200, 0)),
    Cuboid((0.01, 0.02, 0.15), (0.10, 0.10, 0.10), 0.9, (200, 0, 0), heat=1.0),
)
BOOK = standing(0.4, 0.1, (0.16, 0.22, 0.022), 0.3)


def overlaps(points: MapPoints, truth: tuple[Cuboid, ...], settings: FusionSettings = COARSE) -> np.ndarray:
    """IoU (true objects, found objects)."""
    found = find_objects(points, PLANES, settings)
    return iou_matrix_3d([cuboid.box() for cuboid in truth], [item.box for item in found])


@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("nothing", ()),
        ("three boxes", THREE),
        ("one far from the rest", (*THREE, standing(-0.5, -0.4, (0.06, 0.06, 0.06)))),
    ],
)
def test_each_object_is_found_once_and_nothing_else(name: str, truth: tuple[Cuboid, ...]) -> None:
    iou = overlaps(sampled(STAGE + truth), truth)
    assert iou.shape == (len(truth), len(truth)), name
    assert (iou.max(axis=1, initial=0) >= 0.5).all() or not truth


def test_a_flat_book_is_found() -> None:
    assert overlaps(sampled((*STAGE, BOOK)), (BOOK,)).max(initial=0) >= 0.5


@pytest.mark.parametrize("truth", [FACE_TO_FACE, EDGE_TO_FACE, STACKED])
def test_neighbouring_objects_are_split_where_density_alone_joins_them(truth: tuple[Cuboid, ...]) -> None:
    iou = overlaps(sampled(STAGE + truth, step=0.003), truth, FINE)
    assert iou.shape == (2, 2)
    assert (iou.max(axis=1) >= 0.7).all()
    by_density, _ = find_by_density(sampled(STAGE + truth, step=0.005), TABLE_PLANE.plane[None], COARSE_PAPER)
    assert len(by_density) == 1


@pytest.mark.parametrize("gap", [0.003, 0.006, 0.01])
def test_an_object_broken_in_two_by_pose_error_is_one(gap: float) -> None:
    """Half of the views put the object `gap` metres aside: two shells, one in the other."""
    truth = standing(0.0, 0.0, (0.14, 0.12, 0.16), 0.4)
    shift = np.zeros((3, 3))
    whole = sampled((*STAGE, truth))
    shift[2] = [gap, -gap, 0]
    again = sampled((*STAGE, truth), shift=shift)
    moved = again.take(again.heat > 0.4)
    both = MapPoints(*(np.concatenate((getattr(whole, f), getattr(moved, f))) for f in MapPoints.__dataclass_fields__))
    iou = overlaps(both, (truth,))
    assert iou.shape == (1, 1)
    assert iou[0, 0] >= 0.5


def test_a_chair_beside_the_table_is_one_object() -> None:
    """Its back reaches from below the table's height to above it, 15 cm from the table's edge."""
    chair = Cuboid((0.88, 0.0, 0.0), (0.06, 0.4, 0.5), heat=1.0)
    iou = overlaps(sampled((*STAGE, chair)), (chair,))
    assert iou.shape == (1, 1)
    assert iou[0, 0] > 0.7


def test_a_chair_that_touches_the_table_is_one_object() -> None:
    """The board takes what is at its own level from the chair's back."""
    chair = Cuboid((0.735, 0.0, 0.0), (0.06, 0.4, 0.5), heat=1.0)
    iou = overlaps(sampled((*STAGE, chair)), (chair,))
    assert iou.shape == (1, 1)
    assert iou[0, 0] > 0.7


def test_no_box_holds_the_table_that_a_chair_is_pushed_under() -> None:
    """Its seat is below the table, its back beside the table's edge."""
    back = Cuboid((0.78, 0.0, 0.1), (0.04, 0.4, 0.6), heat=1.0)
    seat = Cuboid((0.63, 0.0, -0.19), (0.30, 0.4, 0.02), heat=1.0)
    points = sampled((*STAGE, back, seat))
    found = find_objects(points, PLANES, COARSE)
    table = points.xyz[(points.heat < 0.4) & (points.xyz[:, 2] == 0)]
    assert len(found) == 2
    assert sum(points_in_boxes(table, [item.box]).sum() for item in found) == 0
    assert points_in_boxes(points.xyz[points.heat > 0.4], [item.box for item in found]).mean() > 0.7


def test_what_stands_on_the_table_is_no_part_of_the_chair_beneath_it() -> None:
    """The box around the whole chair would hold the mug above its seat."""
    back = Cuboid((0.78, 0.0, 0.1), (0.04, 0.4, 0.6), heat=1.0)
    seat = Cuboid((0.61, 0.0, -0.19), (0.38, 0.4, 0.02), heat=1.0)
    mug = standing(0.55, 0.0, (0.09, 0.09, 0.10))
    iou = overlaps(sampled((*STAGE, back, seat, mug)), (mug,))
    assert iou.shape == (1, 3)
    assert iou.max() > 0.7


def test_a_thing_at_the_rim_of_a_board_ends_at_the_board() -> None:
    """Its front goes on in the front of the board, which keeps heat."""
    thing = standing(0.0, -0.54, (0.12, 0.12, 0.14))
    points = sampled((*STAGE, thing))
    front = (np.abs(points.xyz[:, 1] + 0.6) < 1e-3) & (np.abs(points.xyz[:, 0]) < 0.3)
    points = replace(points, heat=np.where(front, np.float32(0.5), points.heat))
    iou = overlaps(points, (thing,))
    assert iou.shape == (1, 1)
    assert iou[0, 0] > 0.9


def test_a_surface_that_was_hardly_seen_is_no_object() -> None:
    truth = standing(0.0, 0.0, (0.14, 0.12, 0.16))
    points = sampled((*STAGE, truth))
    # A strip around it.
    strip = np.abs(points.xyz[:, 0] - points.xyz[:, 2] + 0.08) < 0.006
    for seen, count in ((np.ones(len(points), bool), 1), ((points.heat < 0.4) | strip, 0)):
        assert len(find_objects(points.take(seen), PLANES, COARSE)) == count


def test_structure_is_no_object_even_when_it_kept_heat() -> None:
    points = sampled(STAGE + THREE, cold=0.4)
    iou = overlaps(points, THREE)
    assert (iou.max(axis=1) >= 0.5).all()
    assert iou.shape == (3, 3)


def test_without_removing_planes_the_table_spoils_the_result() -> None:
    points = sampled(STAGE + THREE, cold=0.4)
    points = points.take((np.abs(points.xyz[:, 0]) < 0.45) & (np.abs(points.xyz[:, 1]) < 0.3))
    iou = [overlaps(points, THREE, COARSE.model_copy(update={"plane_removal": on})) for on in (True, False)]
    assert iou[0].shape == (3, 3)
    assert (iou[0].max(axis=1) > 0.4).all()
    assert iou[1].shape != (3, 3)  # the table is one more object, or all are one with it


def test_cold_things_beside_a_hot_one_are_no_objects() -> None:
    hot, *others = THREE
    things = (hot, *(replace(thing, heat=0.8 * COARSE.heat_min / 0.6) for thing in others))
    found = find_objects(sampled(STAGE + things, heat=0.6), PLANES, COARSE)
    assert len(found) == 1
    assert iou_matrix_3d([found[0].box], [hot.box()])[0, 0] > 0.3


def test_where_everything_is_cool_the_warmest_count() -> None:
    points = sampled(STAGE + THREE, heat=0.8 * COARSE.heat_min, cold=0.002)
    assert len(find_objects(points, PLANES, COARSE)) == len(THREE)


def test_an_empty_map_and_a_map_without_planes_have_no_objects() -> None:
    points = sampled(STAGE + THREE)
    assert find_objects(points.take(np.zeros(len(points), bool)), PLANES, COARSE) == []
    assert find_objects(points, [], COARSE) == []


@pytest.mark.parametrize(
    ("name", "size", "count"),
    [
        ("an object", (0.2, 0.2, 0.2), 1),
        ("too large", (1.1, 0.3, 0.2), 0),
        ("too small", (0.014, 0.014, 0.014), 0),
    ],
)
def test_size_decides(name: str, size: tuple[float, float, float], count: int) -> None:
    lone = standing(0.0, 0.0, size)
    assert len(find_objects(sampled((*STAGE, lone)), PLANES, COARSE)) == count, name


def test_an_object_is_described_by_its_points() -> None:
    found = find_objects(sampled(STAGE + THREE, heat=0.6), PLANES, COARSE)
    assert [item.confidence for item in found] == sorted((item.confidence for item in found), reverse=True)
    truth = iou_matrix_3d([item.box for item in found], [cuboid.box() for cuboid in THREE]).argmax(axis=1)
    for item, number in zip(found, truth, strict=True):
        assert item.confidence == pytest.approx(0.6, abs=0.02)
        assert item.views == 20
        np.testing.assert_allclose(item.colour, THREE[number].colour, atol=8)
