"""What hangs in the air belongs to what stands beneath it."""

import numpy as np
import pytest
from fusion_room import ROOM, Cuboid, look_at, standing, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project, invert
from spot3d.segments.hanging import join_hanging

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
POSE = look_at((0.0, -0.9, 0.6), (0, 0, 0.1))
TABLE = np.array([0, 0, 1.0, 0]) @ POSE
RED, GREEN, BLUE = (200, 40, 40), (40, 160, 60), (50, 60, 200)
SCREEN = Cuboid((0.0, 0.1, 0.25), (0.3, 0.02, 0.2), colour=RED)
FOOT = standing(0.0, 0.05, (0.2, 0.15, 0.02), colour=GREEN)


def groups_of(
    *things: Cuboid, noise: bool = False, torn: float = 0.0, room: tuple[Cuboid, ...] = ROOM, long: Cuboid | None = None
) -> list[list[int]]:
    """Which of these things are joined. torn: share of the image's height without depth, from the middle down; long:
    what of the room is too long for an object, and above the table."""
    seen = view(POSE, room + things, np.random.default_rng(0) if noise else None, CAMERA)
    depth = seen.depth.copy()
    depth[CAMERA.height // 2 : int(CAMERA.height * (0.5 + torn))] = 0
    points = back_project(depth, CAMERA)
    whose: list[NDArray[np.int64]] = [
        np.flatnonzero((seen.colour == thing.colour).all(axis=-1) & (depth > 0)) for thing in things
    ]
    carriers = np.flatnonzero((seen.colour == long.colour).all(axis=-1) & (depth > 0)) if long else whose[0][:0]
    joined = join_hanging(whose, points, (points @ TABLE[:3] + TABLE[3]).ravel(), invert(POSE)[:3, 2], carriers)
    assert np.array_equal(np.sort(np.concatenate(joined)), np.sort(np.concatenate(whose)))
    return sorted([k for k, pixels in enumerate(whose) if np.isin(pixels, group).all()] for group in joined)


@pytest.mark.parametrize("noise", [False, True])
def test_a_screen_is_one_with_its_foot(noise: bool) -> None:
    beside = standing(-0.35, 0.0, (0.1, 0.1, 0.1), colour=BLUE)
    assert groups_of(SCREEN, FOOT, beside, noise=noise) == [[0, 1], [2]]


def test_a_screen_whose_lower_edge_has_no_depth_is_one_with_its_foot() -> None:
    assert groups_of(SCREEN, FOOT, torn=0.04) == [[0, 1]]


NECK = standing(0.0, 0.07, (0.05, 0.02, 0.25), colour=GREEN)
"""Before the screen, as from behind, with no surface from one to the other."""


@pytest.mark.parametrize("noise", [False, True])
def test_a_screen_is_one_with_the_neck_that_reaches_up_to_it(noise: bool) -> None:
    assert groups_of(SCREEN, NECK, noise=noise) == [[0, 1]]


def test_of_two_things_beneath_it_what_hangs_belongs_to_the_nearer_one() -> None:
    """Both stand behind its middle; the second is 2 cm aside, the first right beneath."""
    block, aside = (
        standing(0.0, 0.1, (0.3, 0.02, 0.02), colour=GREEN),
        standing(0.0, 0.135, (0.28, 0.02, 0.02), colour=BLUE),
    )
    assert groups_of(SCREEN, block, aside) == [[0, 1], [2]]


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize(("torn", "expected"), [(0.0, 1), (0.08, 2)])
def test_beneath_is_beneath_however_the_camera_is_rolled(quarters: int, torn: float, expected: int) -> None:
    seen = view(POSE, (*ROOM, SCREEN, NECK), None, CAMERA)
    depth = seen.depth.copy()
    depth[CAMERA.height // 2 : int(CAMERA.height * (0.5 + torn))] = 0
    points, up = back_project(depth, CAMERA), invert(POSE)[:3, 2]
    height, images = (
        points @ TABLE[:3] + TABLE[3],
        [(seen.colour == c).all(axis=-1) & (depth > 0) for c in (RED, GREEN)],
    )
    for _ in range(quarters):  # what was right is up
        points, up = np.rot90(points)[..., [1, 0, 2]] * np.float32((1, -1, 1)), up[[1, 0, 2]] * (1, -1, 1)
        height, images = np.rot90(height), [np.rot90(image) for image in images]
    points = np.ascontiguousarray(points)
    parts = [np.flatnonzero(image) for image in images]
    assert len(join_hanging(parts, points, height.ravel(), up)) == expected


def test_what_a_hole_in_depth_parts_from_the_table_is_none_of_what_is_before_it() -> None:
    assert groups_of(SCREEN, NECK, torn=0.08) == [[0], [1]]


def test_what_hangs_above_nothing_stays_as_it_is() -> None:
    assert groups_of(SCREEN, standing(0.3, 0.05, (0.1, 0.1, 0.02), colour=GREEN)) == [[0], [1]]


def test_what_stands_on_another_is_another() -> None:
    """Also where it is wider, and hides where it stands."""
    carton = standing(0.0, 0.1, (0.1, 0.1, 0.14), colour=GREEN)
    for width in (0.06, 0.2):
        assert groups_of(Cuboid((0.0, 0.1, 0.17), (width, width, 0.06), colour=RED), carton) == [[0], [1]]


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_handle_at_the_rim_is_a_part_of_the_pan(side: int, noise: bool) -> None:
    """It would fall off; what lies on top of the pan does not."""
    pan = standing(0.0, 0.05, (0.2, 0.2, 0.05), colour=GREEN)
    handle = Cuboid((0.18 * side, 0.05, 0.06), (0.2, 0.03, 0.018), colour=RED)
    spoon = Cuboid((0.07 * side, 0.05, 0.06), (0.2, 0.03, 0.018), colour=RED)
    assert groups_of(handle, pan, noise=noise) == [[0, 1]]
    assert groups_of(spoon, pan, noise=noise) == [[0], [1]]


@pytest.mark.parametrize("noise", [False, True])
def test_a_handle_that_points_at_the_camera_is_a_part_of_the_pan(noise: bool) -> None:
    pan = standing(0.0, 0.05, (0.2, 0.2, 0.05), colour=GREEN)
    handle = Cuboid((0.02, -0.13, 0.06), (0.03, 0.2, 0.018), colour=RED)
    spoon = Cuboid((0.02, 0.0, 0.06), (0.03, 0.2, 0.018), colour=RED)
    assert groups_of(handle, pan, noise=noise) == [[0, 1]]
    assert groups_of(spoon, pan, noise=noise) == [[0], [1]]


@pytest.mark.parametrize(("hidden", "expected"), [(0.1, [[0, 1], [2]]), (0.24, [[0], [1], [2]])])
def test_a_screen_with_something_before_it_is_one_with_its_foot(hidden: float, expected: list[list[int]]) -> None:
    """As long as most of its lower edge, 0.3 m, is seen to hang."""
    foot = standing(0.0, 0.05, (0.28, 0.15, 0.02), colour=GREEN)
    binder = standing(0.0, -0.1, (hidden, 0.05, 0.3), colour=BLUE)
    assert groups_of(SCREEN, foot, binder) == expected


def test_what_something_in_front_hides_below_may_stand() -> None:
    wide = Cuboid((0.0, 0.1, 0.25), (0.36, 0.02, 0.2), colour=RED)
    foot = standing(0.0, 0.05, (0.4, 0.15, 0.02), colour=GREEN)
    assert groups_of(wide, foot) == [[0, 1]]
    assert groups_of(wide, foot, standing(0.0, -0.1, (0.3, 0.04, 0.28), colour=BLUE)) == [[0], [1], [2]]


def test_what_the_image_cuts_off_below_may_stand() -> None:
    """A screen whose lower edge is the image's, above something low in the image's last rows, is no part of it."""
    depth = np.full((40, 60), 1.0, np.float32)
    points = back_project(depth, Intrinsics(60.0, 60.0, 29.5, 19.5, 60, 40))
    up = np.array([0.0, -1.0, 0.0])
    height = np.full(depth.shape, 0.0, np.float32)
    height[:, 10:50] = np.linspace(0.3, 0.06, 40, dtype=np.float32)[:, None]
    height[30:, :10] = 0.01
    number = np.arange(depth.size).reshape(depth.shape)
    screen, low = number[:, 10:50].ravel(), number[30:, 8:10].ravel()
    assert len(join_hanging([screen, low], points, height.ravel(), up)) == 2
    raised = number[:-4, 10:50].ravel()  # not cut off: the same hangs above what is low
    assert len(join_hanging([raised, low], points, height.ravel(), up)) == 1


@pytest.mark.parametrize("noise", [False, True])
def test_what_stands_on_a_shelf_is_no_part_of_what_is_beneath_it(noise: bool) -> None:
    """Though the shelf is longer than an object, and none: it carries what nothing else does."""
    shelf = Cuboid((0, 0.2, 0.23), (1.3, 0.26, 0.02), colour=(3, 4, 5))
    cup = Cuboid((0.0, 0.2, 0.29), (0.1, 0.1, 0.1), colour=RED)
    carton = standing(0.0, 0.1, (0.16, 0.12, 0.15), colour=GREEN)
    for room in (ROOM, (*ROOM, shelf)):
        assert groups_of(cup, carton, noise=noise, room=room) == [[0, 1]], "nobody says what carries it"
    assert groups_of(cup, carton, noise=noise, room=(*ROOM, shelf), long=shelf) == [[0], [1]]


@pytest.mark.parametrize(("behind", "expected"), [(0.0, [[0], [1]]), (0.06, [[0, 1]])])
def test_a_wall_carries_what_is_fixed_to_it_and_no_screen_in_front_of_it(
    behind: float, expected: list[list[int]]
) -> None:
    """behind: how far behind the screen the wall begins, metres."""
    wall = Cuboid((0, 0.13 + behind, 0.5), (3, 0.04, 1.0), colour=(3, 4, 5))
    assert groups_of(SCREEN, FOOT, noise=True, room=(*ROOM[:2], wall), long=wall) == expected


def test_nothing_hangs_on_what_hangs_itself() -> None:
    assert groups_of(SCREEN, Cuboid((0.0, 0.1, 0.08), (0.2, 0.1, 0.02), colour=GREEN)) == [[0], [1]]


def test_without_parts_there_is_nothing_to_join() -> None:
    assert join_hanging([], np.zeros((4, 5, 3), np.float32), np.zeros(20, np.float32), np.array([0, 0, 1.0])) == []
