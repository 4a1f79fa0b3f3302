"""Id switches and jitter of made-up runs whose answers can be counted by hand."""

import numpy as np
import pytest

from spot3d.boxes import Box3D
from spot3d.evaluate.stability import Update, stability

NAN = float("nan")


def cube(x: float, size: tuple[float, float, float] = (1, 1, 1), turned: bool = False) -> Box3D:
    rotation = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) if turned else np.eye(3)
    return Box3D(np.array([x, 0, 0]), np.array(size), rotation)


TRUTH = [cube(0), cube(10)]


def both(id_left: int, id_right: int) -> Update:
    return [(id_left, cube(0)), (id_right, cube(10))]


@pytest.mark.parametrize(
    ("updates", "switches", "matched"),
    [
        ([], [0, 0], [NAN, NAN]),
        ([[], []], [0, 0], [0, 0]),  # nothing found
        ([both(1, 2), both(1, 2)], [0, 0], [1, 1]),
        ([both(1, 2), both(2, 1), both(1, 2)], [2, 2], [1, 1]),  # swapped and back
        ([both(1, 2), [(2, cube(10))], both(1, 2)], [0, 0], [2 / 3, 1]),  # lost and found again
        ([both(1, 2), [(2, cube(10))], both(3, 2)], [1, 0], [2 / 3, 1]),  # found again under another id
        ([[], both(5, 6)], [0, 0], [1 / 2, 1 / 2]),  # first sight is no switch
        ([both(1, 2), [(8, cube(0.7)), *both(1, 2)]], [0, 0], [1, 1]),  # the best box counts, not the first
        ([both(1, 2), [(1, cube(0.7)), (2, cube(10))]], [0, 0], [1 / 2, 1]),  # IoU 0.18 is no match
    ],
)
def test_id_switches(updates: list[Update], switches: list[int], matched: list[float]) -> None:
    measured = stability(updates, TRUTH)
    assert [one.id_switches for one in measured] == switches
    np.testing.assert_allclose([one.matched for one in measured], matched)


def test_without_truth_there_is_nothing_to_measure() -> None:
    assert stability([both(1, 2)], []) == []


def test_the_threshold_of_a_match_is_inclusive_and_can_be_set() -> None:
    half = [[(1, cube(0, (1, 1, 0.5)))]]
    assert stability(half, [cube(0)], threshold=0.5)[0].matched == 1
    assert stability(half, [cube(0)], threshold=0.51)[0].matched == 0


@pytest.mark.parametrize(
    ("boxes", "centre", "size"),
    [
        ([], NAN, NAN),
        ([cube(0)], NAN, NAN),  # one update moves nothing
        ([cube(0), None, cube(0), None], NAN, NAN),  # never in two updates running
        ([cube(0)] * 6, 0, 0),
        ([cube(0), cube(0.3), cube(0), cube(0.1), cube(0.1), cube(0.1)], 0, 0),  # only the last half counts
        ([cube(0), cube(0), cube(0.1), cube(0.1), cube(0.3), cube(0.25)], 0.125, 0),  # moves of 0.2 and 0.05
        ([cube(0)] * 3 + [cube(0), cube(0, (1, 1, 0.8)), cube(0, (1, 1, 1))], 0, 0.2),
        ([cube(0, (1, 0.8, 1)), cube(0, (0.8, 1, 1), turned=True)] * 2, 0, 0),  # the same box, axes renamed
    ],
)
def test_jitter(boxes: list[Box3D | None], centre: float, size: float) -> None:
    updates = [[] if box is None else [(1, box)] for box in boxes]
    (measured,) = stability(updates, [cube(0)])
    np.testing.assert_allclose(measured.centre_jitter, centre, atol=1e-12)
    np.testing.assert_allclose(measured.size_jitter, size, atol=1e-12)
