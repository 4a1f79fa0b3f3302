"""Holes in depth that colour and borders say belong to an object are parts of it; others are not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.segments.holes import fill_holes, join_across_holes

RED, BLUE, TABLE = (200, 40, 40), (50, 60, 200), (180, 150, 110)
FOCAL = 300.0
"""Pixels; all depth here is 1 m, so that watershed reaches 15 pixels deep."""


def painted(edge: int) -> NDArray[np.uint8]:
    """A picture of a table with something red on it left of a column, and something blue right of it."""
    colour = np.full((30, 40, 3), (180, 150, 110), np.uint8)
    colour[5:25, 5:edge], colour[5:25, edge:36] = RED, BLUE
    return colour


@pytest.mark.parametrize("edge", [14, 20, 27])
def test_a_hole_is_shared_out_along_the_edges_of_colour(edge: int) -> None:
    labels, valid = np.zeros((30, 40), np.int32), np.ones((30, 40), np.bool_)
    labels[5:25, 5:12], labels[5:25, 29:36] = 1, 2
    valid[5:25, 12:29] = False
    filled = fill_holes(labels, valid.astype(np.float32), painted(edge), FOCAL)
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
    np.testing.assert_array_equal(fill_holes(labels, valid.astype(np.float32), colour, FOCAL), labels)


@pytest.mark.parametrize("thing", [RED, (150, 150, 150)])
def test_what_has_no_depth_up_to_the_images_rim_is_not_a_thing_in_front_of_it(thing: tuple[int, int, int]) -> None:
    """A window, or a room that is larger than the sensor's range, of a colour more like the table's or the thing's."""
    labels, valid = np.zeros((60, 80), np.int32), np.ones((60, 80), np.bool_)
    colour = np.full((60, 80, 3), 200, np.uint8)
    colour[40:] = (180, 150, 110)  # the table
    labels[20:50, 30:50], colour[20:50, 30:50] = 1, thing
    valid[:40], valid[20:40, 30:50] = False, True
    filled = fill_holes(labels, valid.astype(np.float32), colour, FOCAL)
    assert (filled == 1).sum() <= (labels == 1).sum() + 2 * (20 + 20 + 20)
    assert not filled[:15].any()


def test_without_depth_nothing_is_filled() -> None:
    nothing = np.zeros((30, 40), np.int32)
    assert not fill_holes(nothing, nothing.astype(np.float32), painted(20), FOCAL).any()


def test_what_has_not_the_tables_colour_is_of_the_thing_however_deep_the_hole() -> None:
    """A shiny carton of which only the top has depth."""
    labels, depth = np.zeros((80, 60), np.int32), np.ones((80, 60), np.float32)
    colour = np.full((80, 60, 3), TABLE, np.uint8)
    colour[20:70, 20:40], labels[20:26, 20:40], depth[26:72, 18:42] = RED, 1, 0
    filled = fill_holes(labels, depth, colour, FOCAL)
    assert (filled[26:69, 21:39] == 1).mean() > 0.95
    assert not filled[:, :17].any()
    assert not filled[:, 43:].any()


def test_a_hole_far_from_all_things_is_no_things() -> None:
    labels, depth = np.zeros((80, 120), np.int32), np.ones((80, 120), np.float32)
    labels[30:50, 5:25] = 1
    depth[20:60, 80:110] = 0
    colour = np.full((80, 120, 3), TABLE, np.uint8)
    colour[20:60, 80:110] = 255  # glare
    np.testing.assert_array_equal(fill_holes(labels, depth, colour, FOCAL), labels)


@pytest.mark.parametrize(
    ("right", "between", "at", "expected"),
    [(RED, RED, 0.02, 1), (RED, RED, 0.06, 2), (BLUE, RED, 0.02, 2), (RED, BLUE, 0.02, 2), (RED, TABLE, 0.02, 2)],
)
def test_parts_of_one_colour_and_height_are_joined_across_a_hole_of_it(
    right: tuple[int, int, int], between: tuple[int, int, int], at: float, expected: int
) -> None:
    """A keyboard without depth in its middle. Each other row: another height, colour, or hole between."""
    depth, height = np.ones((30, 60), np.float32), np.zeros((30, 60), np.float32)
    colour = np.full((30, 60, 3), TABLE, np.uint8)
    left_part, hole, right_part = np.s_[10:20, 10:20], np.s_[10:20, 20:35], np.s_[10:20, 35:50]
    colour[left_part], colour[hole], colour[right_part] = RED, between, right
    height[left_part], height[right_part], depth[hole] = 0.02, at, 0
    parts = [np.flatnonzero(_mask(depth.shape, part)) for part in (left_part, right_part)]
    joined = join_across_holes(parts, depth, colour, height)
    assert len(joined) == expected
    np.testing.assert_array_equal(np.sort(np.concatenate(joined)), np.sort(np.concatenate(parts)))


def test_parts_that_touch_stay_apart_whatever_hole_is_between_them() -> None:
    """Two boxes of one colour, and a hole at the end of the crease between them."""
    depth, height = np.ones((30, 60), np.float32), np.full((30, 60), 0.1, np.float32)
    colour = np.full((30, 60, 3), TABLE, np.uint8)
    colour[10:20, 10:50], depth[14:20, 26:34] = RED, 0
    left, right = _mask(depth.shape, np.s_[10:20, 10:30]), _mask(depth.shape, np.s_[10:20, 30:50])
    parts = [np.flatnonzero(part & (depth > 0)) for part in (left, right)]
    assert len(join_across_holes(parts, depth, colour, height)) == 2


def _mask(shape: tuple[int, ...], part: tuple[slice, slice]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.bool_)
    mask[part] = True
    return mask
