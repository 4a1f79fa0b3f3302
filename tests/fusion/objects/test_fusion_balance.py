"""What cannot stand by itself belongs to what it stands on, and what stands does not."""

import sys
from collections.abc import Set
from dataclasses import replace
from types import FrameType

import numpy as np
import pytest
from fusion_room import rotation_z

from spot3d.boxes import Box3D
from spot3d.fusion.objects.balance import Numbers, Piece, put_together

UP = np.array([0.0, 0.0, 1.0])
GROUND = 0.0


def piece(
    size: tuple[float, float, float],
    low: float = 0.0,
    at: tuple[float, float] = (0.0, 0.0),
    yaw: float = 0.0,
    ground: float = GROUND,
) -> Piece:
    """An upright box of this size, its bottom at a height."""
    centre = np.array((*at, low + size[2] / 2))
    box = Box3D(centre, np.array(size), rotation_z(yaw))
    return Piece(box, ground, box, leans=False)


def together(*pieces: Piece, cold: Set[int] = frozenset(), size_max: float = 1.0) -> dict[Numbers, Box3D]:
    """What these are, where all but some are hot."""
    return put_together(dict(enumerate(pieces)), set(range(len(pieces))) - cold, UP, size_max)


def groups(*pieces: Piece, cold: Set[int] = frozenset(), size_max: float = 1.0) -> set[Numbers]:
    return set(together(*pieces, cold=cold, size_max=size_max))


SCREEN = piece((0.05, 0.55, 0.32), low=0.15, at=(0.03, 0.0))
NECK = piece((0.03, 0.06, 0.14), low=0.02)
FOOT = piece((0.24, 0.26, 0.13))
BOOK = piece((0.2, 0.15, 0.05))
PLATE = piece((0.24, 0.26, 0.02))


def test_a_screen_belongs_to_its_foot() -> None:
    assert groups(SCREEN, FOOT) == {(0, 1)}


def test_what_is_put_together_is_around_all_of_it() -> None:
    ((numbers, box),) = put_together({3: SCREEN, 7: FOOT}, {3, 7}, UP, 1.0).items()
    assert numbers == (3, 7)
    np.testing.assert_allclose(np.sort(box.size), [0.24, 0.47, 0.55], atol=1e-6)
    np.testing.assert_allclose(box.centre, [0.0, 0.0, 0.235], atol=1e-6)


def test_a_screen_belongs_to_the_neck_before_which_it_hangs() -> None:
    assert groups(SCREEN, NECK) == {(0, 1)}


@pytest.mark.parametrize(("gap", "expected"), [(0.01, {(0, 1)}), (0.03, {(0,), (1,)})])
def test_a_screen_of_which_the_front_is_seen_belongs_to_the_neck_close_behind(
    gap: float, expected: set[Numbers]
) -> None:
    assert groups(SCREEN, piece((0.03, 0.06, 0.14), low=0.02, at=(0.005 - gap - 0.015, 0.0))) == expected


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_what_stands_on_a_neck_that_is_too_thin_belongs_to_its_foot(yaw: float) -> None:
    """Before its neck a screen is thicker than it is fixed: all of it together would stand."""
    place = (0.035 * np.cos(yaw), 0.035 * np.sin(yaw))
    screen, neck = piece((0.042, 0.45, 0.27), 0.13, place, yaw), piece((0.036, 0.065, 0.11), 0.02, yaw=yaw)
    ((numbers, box),) = together(screen, neck, PLATE).items()
    assert numbers == (0, 1, 2)
    assert box.size[2] == pytest.approx(0.4)


def test_what_stands_on_a_broad_thing_does_not_belong_to_what_is_below_that() -> None:
    pole, block = piece((0.03, 0.03, 0.2), low=0.12), piece((0.1, 0.1, 0.1), low=0.02)
    assert groups(pole, block, PLATE) == {(0, 1), (2,)}


def lid(at: float = -0.12, ground: float = GROUND) -> Piece:
    """A sheet that leans back by 20 degrees from a line at this place along x, facing towards +x."""
    whole = piece((0.09, 0.33, 0.22), at=(at - 0.04, 0.0), ground=ground)
    edge = Box3D(np.array((at, 0.0, 0.0)), np.array((0.015, 0.33, 0.0)), np.eye(3))
    return replace(whole, foot=edge, leans=True)


def test_a_lid_belongs_to_what_its_lower_edge_is_on() -> None:
    base = piece((0.24, 0.33, 0.02))
    ((numbers, box),) = together(lid(), base).items()
    assert numbers == (0, 1)
    np.testing.assert_allclose(np.sort(box.size), [0.22, 0.325, 0.33], atol=1e-3)


def test_how_hot_it_is_what_something_is_fixed_to_is_not_asked() -> None:
    ((numbers, box),) = together(SCREEN, FOOT, cold={1}).items()
    assert numbers == (0, 1)
    assert box.size[2] == pytest.approx(0.47)


def test_what_is_cold_is_nothing_unless_what_is_hot_is_fixed_to_it() -> None:
    assert groups(SCREEN, FOOT, cold={0}) == {(1,)}
    assert groups(SCREEN, FOOT, cold={0, 1}) == set()
    assert groups(piece((0.06, 0.06, 0.06), low=0.05), BOOK, cold={1}) == {(0,)}


def test_what_is_hot_is_fixed_to_all_that_carries_it_however_cold() -> None:
    screen, neck = piece((0.042, 0.45, 0.27), 0.13, (0.035, 0.0)), piece((0.036, 0.065, 0.11), 0.02)
    assert groups(screen, neck, PLATE, cold={1, 2}) == {(0, 1, 2)}


def test_what_leans_against_what_is_behind_it_is_its_own() -> None:
    wall, before = piece((0.2, 0.3, 0.3), at=(-0.32, 0.0)), piece((0.1, 0.1, 0.03), at=(0.0, 0.0))
    assert groups(lid(), wall, before) == {(0,), (1,), (2,)}


@pytest.mark.parametrize("yaw", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("at", [(0.0, 0.0), (0.04, 0.02)])
def test_a_cube_on_a_book_is_a_thing_of_its_own(yaw: float, at: tuple[float, float]) -> None:
    assert groups(piece((0.06, 0.06, 0.06), low=0.05, at=at, yaw=yaw), BOOK) == {(0,), (1,)}


def test_what_sticks_out_is_its_own() -> None:
    """What carries it is hidden by it, in part: a thing on it must not look fixed because of that."""
    assert groups(piece((0.13, 0.19, 0.045), low=0.05, at=(0.08, 0.05)), piece((0.08, 0.08, 0.05))) == {(0,), (1,)}


@pytest.mark.parametrize(("height", "together"), [(0.2, False), (0.26, True)])
def test_what_tips_at_ten_degrees_is_fixed(height: float, together: bool) -> None:
    pole = piece((0.04, 0.06, height), low=0.05)  # the tangent of 11 degrees, and of 9
    assert groups(pole, BOOK) == ({(0, 1)} if together else {(0,), (1,)})


def test_a_pole_that_seems_to_reach_the_ground_through_its_base_is_fixed_to_it() -> None:
    base = piece((0.17, 0.17, 0.025))
    assert groups(piece((0.04, 0.06, 0.4)), base) == {(0, 1)}


def test_what_stands_on_the_ground_beside_another_thing_is_its_own() -> None:
    bottle = piece((0.06, 0.06, 0.4), at=(0.12, 0.0))  # the boxes share a centimetre
    assert groups(bottle, BOOK) == {(0,), (1,)}


def test_what_floats_beside_another_thing_is_not_fixed_to_it() -> None:
    hidden_below = piece((0.03, 0.06, 0.2), low=0.06, at=(0.14, 0.0))
    assert groups(hidden_below, BOOK) == {(0,), (1,)}


def test_what_hangs_far_above_is_not_fixed() -> None:
    assert groups(piece((0.05, 0.55, 0.32), low=0.25), BOOK) == {(0,), (1,)}


def test_a_lamp_is_put_together_from_above() -> None:
    tube = piece((0.02, 0.3, 0.12), low=0.4)
    pole, base = piece((0.03, 0.03, 0.38), low=0.02), piece((0.16, 0.16, 0.025))
    assert groups(base, tube, pole) == {(0, 1, 2)}


STOOL = piece((0.33, 0.33, 0.45))


@pytest.mark.parametrize(("aside", "expected"), [(0.14, {(0, 1)}), (0.18, {(0,), (1,)})])
def test_a_leg_belongs_to_the_stool_that_has_most_of_it_in_its_box(aside: float, expected: set[Numbers]) -> None:
    assert groups(STOOL, piece((0.05, 0.05, 0.4), at=(aside, 0.14))) == expected


def test_what_can_stand_within_anothers_box_is_its_own() -> None:
    assert groups(STOOL, piece((0.08, 0.08, 0.2), at=(0.1, 0.1))) == {(0,), (1,)}


def test_nothing_becomes_larger_than_an_object_can_be() -> None:
    assert groups(SCREEN, FOOT, size_max=0.5) == {(0,), (1,)}


def test_where_no_ground_is_known_a_thing_floats() -> None:
    unknown = piece((0.05, 0.55, 0.32), low=0.02, at=(0.03, 0.0), ground=np.nan)
    assert groups(unknown, piece((0.03, 0.06, 0.02))) == {(0, 1)}


def calls_for(count: int) -> int:
    """How many calls of Python functions it takes to put this many thin things together, which hang far apart."""
    things, calls, before = [piece((0.02, 0.2, 0.3 + k / 1000), low=0.7 * k) for k in range(count)], 0, sys.getprofile()

    def count_call(_frame: FrameType, event: str, _: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count_call)
    try:
        found = groups(*things)
    finally:
        sys.setprofile(before)
    assert found == {(number,) for number in range(count)}
    return calls


def test_nothing_is_computed_anew_for_each_pair_of_things() -> None:
    """A thousand objects took six seconds an update."""
    calls_for(2)  # imports
    assert calls_for(160) < 2.2 * calls_for(80)


def test_no_and_one_piece() -> None:
    assert groups() == set()
    assert groups(SCREEN) == {(0,)}


def test_the_order_of_the_pieces_does_not_matter() -> None:
    pieces = (SCREEN, FOOT, piece((0.2, 0.15, 0.05), at=(0.6, 0.0)))
    assert {len(group) for group in groups(*pieces)} == {len(group) for group in groups(*pieces[::-1])} == {1, 2}
