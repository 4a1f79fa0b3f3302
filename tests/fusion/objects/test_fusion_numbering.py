"""Which clusters are new, and which number an object has."""

import numpy as np
import pytest

from spot3d.fusion.objects.numbering import number_clusters, number_objects


@pytest.mark.parametrize(
    ("name", "found", "before", "touched", "expected"),
    [
        ("as before", [1, 1, 0], [5, 5, 3], [0, 0, 0], [5, 5, 3]),
        ("one of them is touched", [1, 1, 0], [5, 5, 3], [0, 1, 0], [9, 9, 3]),
        ("two joined", [0, 0, 0], [5, 5, 3], [0, 0, 0], [9, 9, 9]),
        ("one in two", [0, 1, 2], [5, 5, 3], [0, 0, 0], [9, 10, 3]),
        ("one has left for none", [0, -1, 1], [5, 5, 3], [0, 0, 0], [9, -1, 3]),
        ("never in a cluster", [0, 0, 1], [-1, -1, 3], [0, 0, 0], [9, 9, 3]),
        ("in none", [-1, -1, -1], [5, -1, 3], [1, 1, 1], [-1, -1, -1]),
    ],
)
def test_a_cluster_of_the_same_untouched_segments_keeps_its_number(
    name: str, found: list[int], before: list[int], touched: list[int], expected: list[int]
) -> None:
    number, new = number_clusters(np.array(found), np.array(before), np.array(touched, bool), 9)
    assert (number.tolist(), new) == (expected, len({k for k in expected if k >= 9})), name


def test_an_object_has_the_number_that_most_of_its_segments_had() -> None:
    last, former = np.array([4, 4, 7, 4, 7, 0, 0]), np.array([2, 2, 2, 3, 1, 1, 5])
    objects = [np.array(rows) for rows in ([0, 1, 2], [3, 4], [5], [6])]
    assert number_objects(objects, (last, former), set(), 9) == [4, 7, 1, 5]
    assert number_objects(objects, (last, former), {7, 5}, 9) == [4, 1, 9, 10]
