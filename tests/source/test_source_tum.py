"""Which lines of TUM's lists belong together."""

import numpy as np
import pytest

from spot3d.source.tum import nearest_in_time


@pytest.mark.parametrize(
    ("stamps", "others", "expected"),
    [
        ([], [], []),
        ([5], [], [-1]),
        ([0], [20_000_000], [0]),
        ([0], [20_000_001], [-1]),
        ([100_000_000, 110_000_000], [95_000_000, 108_000_000], [0, 1]),
    ],
)
def test_nearest_in_time(stamps: list[int], others: list[int], expected: list[int]) -> None:
    found = nearest_in_time(np.array(stamps, np.int64), np.array(others, np.int64))
    assert found.tolist() == expected
