"""Inverse depth without holes, by hand."""

import numpy as np
import pytest

from spot3d.geometry.inverse_depth import fill_inverse_depth


def filled_inverse(depth: np.ndarray) -> np.ndarray:
    """Into an array that holds something else."""
    inverse = np.full_like(depth, 7)
    fill_inverse_depth(depth, inverse)
    return inverse


@pytest.mark.parametrize(
    ("row", "filled"),
    [
        ([0, 0, 0, 0], [0, 0, 0, 0]),
        ([0, 2, 0, 0], [2, 2, 2, 2]),
        ([1, 0, 0, 4], [1, 4, 4, 4]),
        ([4, 0, 1, 0], [4, 4, 1, 1]),
    ],
)
def test_holes_take_the_farther_end(row, filled):
    inverse = filled_inverse(np.array([row], np.float32))
    expected = np.array([filled], np.float32)
    np.testing.assert_allclose(inverse, np.divide(1, expected, where=expected > 0, out=expected * 0))


def test_empty_rows_repeat_the_nearest():
    depth = np.array([[0, 0], [1, 2], [0, 0], [4, 4]], np.float32)
    np.testing.assert_allclose(filled_inverse(depth), [[1, 0.5], [1, 0.5], [1, 0.5], [0.25, 0.25]])
