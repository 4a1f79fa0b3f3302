"""Pieces of one surface around a hole in depth are one object; other things beside a hole are not."""

import numpy as np
import pytest
from fusion_room import ROOM, Cuboid, look_at, standing, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.geometry.normals import surface_normals
from spot3d.segments.torn import fill_holes, join_torn

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


def painted(edge: int) -> NDArray[np.uint8]:
    """A picture of a table with something red on it left of a column, and something blue right of it."""
    colour = np.full((30, 40, 3), (180, 150, 110), np.uint8)
    colour[5:25, 5:edge], colour[5:25, edge:36] = RED, BLUE
    return colour


def filled_in(labels: NDArray[np.int32], valid: NDArray[np.bool_], colour: NDArray[np.uint8]) -> NDArray[np.int32]:
    """A metre away, where a pixel is a centimetre wide."""
    camera = Intrinsics(100.0, 100.0, 20.0, 15.0, labels.shape[1], labels.shape[0])
    return fill_holes(labels, back_project(valid.astype(np.float32), camera), colour, camera.fx)


@pytest.mark.parametrize("edge", [14, 20, 27])
def test_a_hole_is_shared_out_along_the_edges_of_colour(edge: int) -> None:
    labels, valid = np.zeros((30, 40), np.int32), np.ones((30, 40), np.bool_)
    labels[5:25, 5:12], labels[5:25, 29:36] = 1, 2
    valid[5:25, 12:29] = False
    filled = filled_in(labels, valid, painted(edge))
    np.testing.assert_array_equal(filled[valid], labels[valid])
    row = filled[15]
    assert np.flatnonzero(row == 1).max() == pytest.approx(edge - 1, abs=1)
    assert np.flatnonzero(row == 2).min() == pytest.approx(edge, abs=1)


def test_a_hole_of_the_table_stays_the_tables() -> None:
    labels, valid = np.zeros((30, 40), np.int32), np.ones((30, 40), np.bool_)
    labels[5:25, 5:15] = 1
    valid[10:20, 25:30] = False
    colour = painted(15)
    colour[5:25, 15:36] = colour[0, 0]
    np.testing.assert_array_equal(filled_in(labels, valid, colour), labels)


@pytest.mark.parametrize("thing", [RED, (150, 150, 150)])
def test_what_has_no_depth_up_to_the_images_rim_is_not_a_thing_in_front_of_it(thing: tuple[int, int, int]) -> None:
    """A window, or a room that is larger than the sensor's range, of a colour more like the table's or the thing's."""
    labels, valid = np.zeros((60, 80), np.int32), np.ones((60, 80), np.bool_)
    colour = np.full((60, 80, 3), 200, np.uint8)
    colour[40:] = (180, 150, 110)  # the table
    labels[20:50, 30:50], colour[20:50, 30:50] = 1, thing
    valid[:40], valid[20:40, 30:50] = False, True
    filled = filled_in(labels, valid, colour)
    assert not filled[:15].any()
    assert not filled[:, :25].any()
    assert not filled[:, 55:].any()


def test_without_depth_nothing_is_filled() -> None:
    nothing = np.zeros((30, 40), np.int32)
    assert not filled_in(nothing, nothing > 0, painted(20)).any()
