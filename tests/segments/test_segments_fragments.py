"""Fragments join what they lie beside; what has a shape of its own, or lies apart, stays."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.segments.fragments import join_fragments

CAMERA = Intrinsics(250.0, 250.0, 79.5, 59.5, 160, 120)
LEAST, GAP = 60, 0.02


def flat(depth: float = 1.0) -> NDArray[np.float32]:
    """A wall across the view, where a pixel is 4 mm wide at 1 m."""
    return back_project(np.full(CAMERA.shape, depth, np.float32), CAMERA)


def joined(labels: NDArray[np.int32], points: NDArray[np.float32] | None = None) -> NDArray[np.int32]:
    return join_fragments(labels, flat() if points is None else points, CAMERA.fx, LEAST, GAP)


def nothing() -> NDArray[np.int32]:
    return np.full(CAMERA.shape, -1, np.int32)


def test_no_regions_are_no_regions() -> None:
    np.testing.assert_array_equal(joined(nothing()), nothing())


def test_a_pen_in_pieces_is_one() -> None:
    labels = nothing()
    for number in range(5):
        labels[50:54, 20 + 11 * number : 28 + 11 * number] = number
    after = joined(labels)
    assert len(np.unique(after[after >= 0])) == 1
    np.testing.assert_array_equal(after >= 0, labels >= 0)


def test_a_fragment_joins_the_nearest_thing() -> None:
    labels = nothing()
    labels[40:60, 20:40], labels[40:60, 50:70] = 0, 1
    labels[48:52, 43:46] = 2
    assert joined(labels)[50, 44] == 0


def test_two_things_beside_each_other_stay_two() -> None:
    labels = nothing()
    labels[40:60, 20:40], labels[40:60, 41:60] = 0, 1
    np.testing.assert_array_equal(joined(labels), labels)


def test_a_fragment_that_lies_apart_stays() -> None:
    labels = nothing()
    labels[40:60, 20:40], labels[48:52, 50:54] = 0, 1
    np.testing.assert_array_equal(joined(labels), labels)


def test_what_is_beside_a_thing_but_behind_it_stays() -> None:
    labels, points = nothing(), flat()
    labels[40:60, 20:40], labels[48:52, 41:45] = 0, 1
    points[:, 41:] = flat(1.1)[:, 41:]
    np.testing.assert_array_equal(joined(labels, points), labels)


def test_the_gap_is_wider_in_pixels_the_nearer_it_is() -> None:
    """Seven pixels are 1.4 cm at half a metre."""
    labels = nothing()
    labels[40:60, 20:40], labels[48:52, 46:50] = 0, 1
    assert joined(labels, flat(0.5))[50, 48] == 0
    np.testing.assert_array_equal(joined(labels), labels)
