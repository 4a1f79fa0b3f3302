"""Which points of the map count: min(5, 5 %) and the pseudo-average confidence (Eq. 15)."""

import numpy as np
import pytest

from spot3d.fusion.map.map_arrays import COLUMNS, FREQUENCY, HEAT, R, X
from spot3d.fusion.map.selection import frequent_points
from spot3d.fusion.settings import FusionSettings

SETTINGS = FusionSettings(frequency_min=5, frequency_share=0.05, tau=10.0, tau_share=1.0)


def rows_seen(frequencies: list[int], heat: float = 0.0) -> np.ndarray:
    rows = np.zeros((len(frequencies), COLUMNS), np.float32)
    rows[:, FREQUENCY], rows[:, HEAT] = frequencies, heat
    return rows


@pytest.mark.parametrize(
    ("frames", "least"),
    [(0, 1), (1, 1), (20, 1), (21, 2), (40, 2), (60, 3), (99, 5), (100, 5), (101, 5), (10_000, 5)],
)
def test_points_seen_too_seldom_are_dropped(frames: int, least: int) -> None:
    kept = frequent_points(rows_seen([0, 1, 2, 3, 4, 5, 6, 50]), frames, SETTINGS)  # 0: the row is free
    assert kept.frequency.min() == least
    assert len(kept) == sum(f >= least for f in (1, 2, 3, 4, 5, 6, 50))


@pytest.mark.parametrize(
    ("heat", "frequency", "tau", "expected"), [(0, 5, 10, 0), (5, 5, 10, 1 / 3), (90, 90, 10, 0.9), (3, 6, 0, 0.5)]
)
def test_pseudo_average_confidence(heat: float, frequency: int, tau: float, expected: float) -> None:
    points = frequent_points(rows_seen([frequency], heat), 100, FusionSettings(tau=tau, tau_share=1.0))
    assert points.heat[0] == pytest.approx(expected)


def test_an_empty_map_has_none() -> None:
    assert len(frequent_points(rows_seen([]), 100, SETTINGS)) == 0


def test_columns_are_copied() -> None:
    rows = rows_seen([9, 9])
    rows[:, X : X + 3], rows[:, R : R + 3] = [[1, 2, 3]], [[10, 20, 30]]
    points = frequent_points(rows, 9, SETTINGS)
    rows[:] = -1
    np.testing.assert_array_equal(points.xyz, [[1, 2, 3]] * 2)
    np.testing.assert_array_equal(points.colour, [[10, 20, 30]] * 2)
    assert len(points.take(np.array([False, True]))) == 1


@pytest.mark.parametrize(("frames", "expected"), [(20, 6 / 7), (100, 6 / 11), (1000, 6 / 16)])
def test_tau_grows_with_a_run_up_to_its_value(frames: int, expected: float) -> None:
    settings = FusionSettings(tau=10.0, tau_share=0.05)
    assert frequent_points(rows_seen([6], 6.0), frames, settings).heat[0] == pytest.approx(expected)


def test_tau_without_a_share_is_as_given() -> None:
    settings = FusionSettings(tau=10.0, tau_share=0.0)
    assert frequent_points(rows_seen([6], 6.0), 20, settings).heat[0] == pytest.approx(6 / 16)
