"""Which segments are of what is not there any more."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.fusion.objects.gone import gone_segments
from spot3d.fusion.objects.views import BACKGROUND, THROUGH, WHOLE

FRAME = 20
"""The view that the segment in question is of."""


def said(*answers: tuple[int, int], row: int = 1) -> NDArray[np.int32]:
    """What views say of the segment in a row: each view's number, and what it says."""
    return np.array([(row, view, what, -1) for view, what in answers], np.int32).reshape(-1, 4)


def through(first: int, end: int) -> list[tuple[int, int]]:
    return [(view, THROUGH) for view in range(first, end)]


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([], False),
        (through(21, 30), False),
        (through(21, 31), True),
        (through(10, 20) + through(21, 30), False),  # views from before it was there
        ([*through(21, 31), (31, WHOLE)], False),
        ([(31, BACKGROUND), *through(21, 31)], False),  # in whatever order they say it
        ([*through(21, 26), (26, BACKGROUND), *through(27, 37)], True),
        ([*through(21, 26), (26, BACKGROUND), *through(27, 36)], False),
        ([(view, WHOLE) for view in range(21, 60)] + through(60, 70), True),
    ],
)
def test_the_ten_latest_of_later_views_look_through_it(answers: list[tuple[int, int]], expected: bool) -> None:
    others = np.concatenate((said(*through(0, 9), row=0), said(*through(25, 35), row=2)))
    told = np.random.default_rng(0).permutation(np.concatenate((said(*answers), others)))
    np.testing.assert_array_equal(gone_segments(told, np.array([0, FRAME, 3])), [False, expected, True])


def test_of_nothing_there_is_nothing() -> None:
    assert gone_segments(np.zeros((0, 4), np.int32), np.zeros(0, np.int64)).shape == (0,)
    assert not gone_segments(np.zeros((0, 4), np.int32), np.zeros(3, np.int64)).any()
