"""Growing rows hold what was put in, and cost what is added."""

import numpy as np
import pytest

from spot3d.fusion.objects.growing import Growing


@pytest.mark.parametrize("parts", [(), (0,), (1, 0, 2), (3, 5, 1, 1, 40)])
def test_rows_are_what_was_added(parts: tuple[int, ...]) -> None:
    whole = np.arange(2 * sum(parts), dtype=np.float32).reshape(-1, 2)
    grown = Growing[np.float32](np.float32, 2)
    for part in np.split(whole, np.cumsum(parts)[:-1]) if parts else ():
        grown.extend(part)
    assert len(grown) == len(whole)
    assert grown.rows.dtype == np.float32
    np.testing.assert_array_equal(grown.rows, whole)


def test_what_is_kept_keeps_its_order_and_others_follow() -> None:
    grown = Growing[np.int64](np.int64)
    grown.extend(np.arange(10))
    grown.keep(grown.rows % 2 == 0)
    grown.extend(np.array([7]))
    grown.keep(np.arange(len(grown)) >= 1)
    assert grown.rows.tolist() == [2, 4, 6, 8, 7]


def test_rows_are_moved_seldom() -> None:
    grown, places = Growing[np.int64](np.int64), set()
    for number in range(1000):
        grown.extend(np.array([number]))
        places.add(grown.rows.__array_interface__["data"][0])
    assert len(places) < 20
