"""Holes in depth that colour and borders say belong to an object are parts of it; others are not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.segments.holes import fill_holes

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
