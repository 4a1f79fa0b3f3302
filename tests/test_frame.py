"""Depth as every stage's core sees it: metres, and 0 where there is none."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame


def metres(depth: np.ndarray, scale: float) -> np.ndarray:
    """The metres of a row of depth, of which none may change."""
    camera = Intrinsics(10.0, 10.0, 0.0, 0.0, depth.shape[1], 1)
    before = depth.copy()
    found = RgbdFrame(0, np.zeros((*depth.shape, 3), np.uint8), depth, scale, camera).depth_metres()
    np.testing.assert_array_equal(depth, before)
    assert found.dtype == np.float32
    return found[0]


@pytest.mark.parametrize(
    ("depth", "scale", "expected"),
    [
        (np.array([[0, 1500, 65535]], np.uint16), 0.001, [0, 1.5, 65.535]),
        (np.array([[0, 9999, 10001, 65535]], np.uint16), 10.0, [0, 99990, 0, 0]),
        (np.array([[0, 0.5, 1500.0, 1e5]], np.float32), 1.0, [0, 0.5, 1500, 1e5]),
        (np.array([[np.nan, np.inf, -np.inf, -1.0, 2.0]], np.float32), 1.0, [0, 0, 0, 0, 2]),
        (np.array([[1.001e5, 3e7, 1e20, 3.4e38]], np.float32), 1.0, [0, 0, 0, 0]),
        (np.array([[500.0, 99.9e6, 100.1e6]], np.float32), 0.001, [0.5, 99.9e3, 0]),
    ],
)
def test_what_no_camera_measures_is_no_depth(depth: np.ndarray, scale: float, expected: list[float]) -> None:
    np.testing.assert_allclose(metres(depth, scale), expected, rtol=1e-6)
