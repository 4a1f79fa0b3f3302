"""Line charts of measured values, some of which are not known."""

from math import inf, nan

import numpy as np
import pytest

from spot3d.drawing.charts import Line, line_chart

KNOWN = [(0.0, 1.0), (1.0, 2.0), (3.0, 3.0)]


@pytest.mark.parametrize("unknown", [(2.0, nan), (nan, 2.0), (inf, 1.0), (2.0, inf), (2.0, -inf)])
def test_points_that_are_not_finite_are_left_out(unknown: tuple[float, float]) -> None:
    drawn = line_chart("memory", "minutes", "MB", [Line("fusion", [unknown, *KNOWN, unknown]), Line("pose", [unknown])])
    np.testing.assert_array_equal(
        drawn, line_chart("memory", "minutes", "MB", [Line("fusion", KNOWN), Line("pose", [])])
    )
    assert (drawn == (0, 114, 178)).all(axis=2).any()
