"""Quantiles of rows."""

import numpy as np
import pytest

from spot3d.geometry.quantiles import quantiles


@pytest.mark.parametrize("trim", [0.0, 0.005, 0.02, 0.3, 0.5])
@pytest.mark.parametrize("count", [1, 2, 3, 50, 1000])
def test_quantiles_are_the_plain_ones(count: int, trim: float) -> None:
    rng = np.random.default_rng(count)
    values = rng.normal(0, [[1e-3], [1.0], [1.0], [1.0]], (4, count))
    values[2] = np.round(values[2])  # the same value many times
    values[3] = np.maximum(values[3], 0)
    np.testing.assert_allclose(
        quantiles(values, trim, 1 - trim), np.quantile(values, [trim, 1 - trim], axis=1), atol=1e-12
    )


def test_of_equal_values_that_very_one_is_found() -> None:
    assert quantiles(np.full((1, 9), 0.3), 0.5)[0].tolist() == [0.3]
    assert quantiles(np.repeat([[0.1, 0.7, 0.9]], 5, axis=1), 0.5)[0].tolist() == [0.7]


def test_of_one_row_there_is_one_value_for_each_share() -> None:
    assert [float(value) for value in quantiles(np.array([4, 1, 3], np.float32), 0.25, 0.5, 1.0)] == [2.0, 3.0, 4.0]
