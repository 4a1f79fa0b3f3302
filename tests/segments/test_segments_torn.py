"""Pieces of one surface around a hole in depth are one object; other things beside a hole are not."""

import numpy as np
import pytest
from fusion_room import ROOM, Cuboid, look_at, standing, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.geometry.normals import surface_normals
from spot3d.segments.torn import join_torn

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
POSE = look_at((0.0, -0.9, 0.4), (0, 0, 0.08))
LEAST = 90
RED, BLUE = (200, 40, 40), (50, 60, 200)
CARTON = standing(0, 0, (0.2, 0.06, 0.16), colour=RED)


def pieces(
    *things: Cuboid, hole: NDArray[np.bool_], specks: tuple[tuple[int, int], ...] = ()
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels of the things' pieces left and right of a hole, from left to right, before and after they are joined.

    specks: middles, (row, column), of patches of 3 x 3 pixels within the hole that have depth all the same; each is a
    piece.
    """
    seen = view(POSE, ROOM + things, np.random.default_rng(0), CAMERA)
    patches = np.zeros(CAMERA.shape, np.int32)
    for number, (v, u) in enumerate(specks):
        patches[v - 1 : v + 2, u - 1 : u + 2] = number + 1
    depth = np.where(hole & (patches == 0), 0, seen.depth).astype(np.float32)
    on_thing = (seen.colour[..., None, :] == [thing.colour for thing in things]).all(-1).any(-1) & (depth > 0)
    right = np.arange(CAMERA.width) > np.mean(np.nonzero(hole)[1])
    labels = np.where(on_thing, np.where(patches > 0, patches + 1, right), -1).astype(np.int32)
    points = back_project(depth, CAMERA)
    return labels, join_torn(labels, points, surface_normals(depth, CAMERA), LEAST)


def columns(start: int, end: int) -> NDArray[np.bool_]:
    """A hole over the whole height of the image."""
    hole = np.zeros(CAMERA.shape, np.bool_)
    hole[:, start:end] = True
    return hole


def names(labels: NDArray[np.int32]) -> list[int]:
    return np.unique(labels[labels >= 0]).tolist()


@pytest.mark.parametrize("width", [4, 8, 14])
def test_a_torn_box_is_joined(width: int) -> None:
    before, after = pieces(CARTON, hole=columns(160 - width // 2, 160 + width // 2))
    assert names(before) == [0, 1]
    assert names(after) == [0]
    np.testing.assert_array_equal(before >= 0, after >= 0)


def test_a_hole_too_wide_to_look_across_parts() -> None:
    assert names(pieces(CARTON, hole=columns(148, 174))[1]) == [0, 1]  # more than 5 cm


@pytest.mark.parametrize(
    ("name", "left", "right"),
    [
        ("two things, a gap between them", (-0.08, 0.0), (0.08, 0.0)),
        ("one before the other", (-0.06, -0.1), (0.06, 0.1)),
    ],
)
def test_two_boxes_beside_a_hole_are_not_joined(
    name: str, left: tuple[float, float], right: tuple[float, float]
) -> None:
    things = standing(*left, (0.1, 0.1, 0.12), colour=RED), standing(*right, (0.1, 0.1, 0.12), colour=BLUE)
    seen = view(POSE, ROOM + things, None, CAMERA)
    ends = np.nonzero((seen.colour == RED).all(-1))[1].max(), np.nonzero((seen.colour == BLUE).all(-1))[1].min()
    middle = int(np.mean(ends))
    assert names(pieces(*things, hole=columns(middle - 5, middle + 5))[1]) == [0, 1], name


def test_two_walls_of_a_corner_beside_a_hole_are_not_joined() -> None:
    """A box with its end to a higher one's side: their surfaces meet in a crease, in the hole."""
    along = standing(0.04, 0.05, (0.2, 0.06, 0.1), colour=RED)
    towards = standing(0.18, -0.02, (0.08, 0.24, 0.18), colour=BLUE)
    seam = int(np.nonzero((view(POSE, (*ROOM, along, towards), None, CAMERA).colour == RED).all(-1))[1].max())
    assert names(pieces(along, towards, hole=columns(seam - 3, seam + 4))[1]) == [0, 1]


def test_a_speck_in_a_hole_belongs_to_the_thing_that_is_torn() -> None:
    """Too few pixels to tell where they face."""
    before, after = pieces(CARTON, hole=columns(150, 170), specks=((110, 160),))
    assert names(before) == [0, 1, 2]
    assert names(after) == [0]


def test_without_holes_nothing_is_joined() -> None:
    before, after = pieces(CARTON, hole=columns(0, 0) | (np.arange(320) < 1))
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize("label", [-1, 0])
def test_without_depth_there_is_nothing_to_join(label: int) -> None:
    labels, points = np.full((12, 16), label, np.int32), np.zeros((12, 16, 3), np.float32)
    np.testing.assert_array_equal(join_torn(labels, points, points, LEAST), labels)


def around_a_hole(bend: float, *regions: tuple[slice, slice]) -> list[int]:
    """What these regions of a wall are joined to, which a hole divides: two halves that meet in an angle of it.

    bend: by so much the halves slope, towards the camera from the middle on.
    """
    u = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    depth = np.tile(1 / (1 + bend * np.abs(u)), (CAMERA.height, 1)).astype(np.float32)
    depth[:, 157:163] = 0
    labels = np.full(CAMERA.shape, -1, np.int32)
    for number, region in enumerate(regions):
        labels[region] = number
    labels[depth == 0] = -1
    points = back_project(depth, CAMERA)
    return names(join_torn(labels, points, surface_normals(depth, CAMERA), LEAST))


LEFT, RIGHT = np.s_[60:160, 60:160], np.s_[60:160, 160:260]


@pytest.mark.parametrize(("bend", "expected"), [(0.5, [0, 1]), (0.0, [0]), (-0.5, [0])])
def test_halves_that_meet_in_a_crease_are_two_and_at_an_edge_one(bend: float, expected: list[int]) -> None:
    assert around_a_hole(bend, LEFT, RIGHT) == expected


def test_a_piece_too_small_to_tell_where_it_faces_is_joined_even_in_a_crease() -> None:
    assert around_a_hole(0.5, LEFT, np.s_[100:110, 163:171]) == [0]


def test_a_small_piece_meets_a_large_one_along_much_of_its_own_rim() -> None:
    assert around_a_hole(0.0, LEFT, np.s_[100:110, 163:175]) == [0]


def test_what_touches_without_a_hole_between_is_not_joined() -> None:
    assert around_a_hole(0.0, np.s_[60:160, 60:110], np.s_[60:160, 110:150]) == [0, 1]
