import numpy as np
import pytest

from spot3d.proposals.nms import suppress
from spot3d.proposals.windows import window_shapes


@pytest.mark.parametrize(
    ("windows", "beta", "most", "kept"),
    [
        ([], 0.75, 10, []),
        ([(0, 0, 10, 10)], 0.75, 10, [0]),
        ([(0, 0, 10, 10), (0, 0, 10, 9)], 0.75, 10, [0]),
        ([(0, 0, 10, 10), (0, 0, 10, 9)], 0.95, 10, [0, 1]),
        ([(0, 0, 10, 10), (50, 50, 60, 60), (0, 1, 10, 10)], 0.5, 10, [0, 1]),
        ([(0, 0, 10, 10), (50, 50, 60, 60), (20, 0, 30, 10)], 0.5, 2, [0, 1]),
        ([(0, 0, 10, 10), (0, 0, 100, 100)], 0.5, 10, [0, 1]),
    ],
)
def test_suppression(windows, beta, most, kept):
    array = np.array(windows, np.int32).reshape(-1, 4)
    order = np.arange(len(windows), dtype=np.int64)
    assert suppress(array, order, np.float32(beta), np.float32(1), most).tolist() == kept


def test_a_falling_threshold_keeps_fewer():
    rng = np.random.default_rng(0)
    corner, size = rng.integers(0, 40, (300, 2)), rng.integers(20, 60, (300, 2))
    windows = np.hstack((corner, corner + size)).astype(np.int32)
    order = np.arange(300, dtype=np.int64)
    fixed, falling = (suppress(windows, order, np.float32(0.9), np.float32(eta), 300) for eta in (1, 0.98))
    assert len(falling) < len(fixed)


@pytest.mark.parametrize("alpha", [0.4, 0.5, 0.65])
def test_search_windows_cover_sizes_and_shapes_with_overlap_alpha(alpha):
    shapes = window_shapes(640, 480, alpha, 3.0, 1000.0)
    w, h, step_x, step_y = shapes.T
    assert (w <= 640).all()
    assert (h <= 480).all()
    assert (w * h).min() == pytest.approx(1000, rel=0.1)
    assert (w * h).max() > 0.3 * 640 * 480
    assert (np.maximum(w / h, h / w) < 3.2).all()
    np.testing.assert_allclose((w - step_x) / (w + step_x), alpha, atol=0.06)
    np.testing.assert_allclose((h - step_y) / (h + step_y), alpha, atol=0.06)


def test_an_image_smaller_than_any_window_has_none():
    assert window_shapes(3, 3, 0.5, 3.0, 1000.0).shape == (0, 4)
