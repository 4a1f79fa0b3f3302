import numpy as np
import pytest

from spot3d.proposals.groups import group_edges
from spot3d.proposals.nms import suppress
from spot3d.proposals.scoring import score_window
from spot3d.proposals.window_index import WindowIndex, index_windows
from spot3d.proposals.windows import refine, window_shapes


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
    assert suppress(array, order, np.float32(beta), most).tolist() == kept


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


def outline(x0: int, y0: int, x1: int, y1: int) -> WindowIndex:
    """Index of a rectangle's outline, for which x0..x1 - 1, y0..y1 - 1 is the smallest window without a crossing."""
    magnitude, orientation = np.zeros((240, 320), np.float32), np.zeros((240, 320), np.float32)
    rows, columns = slice(y0 + 1, y1 - 1), slice(x0 + 1, x1 - 1)
    magnitude[rows, [x0 + 1, x1 - 2]] = magnitude[[y0 + 1, y1 - 2], columns] = 1
    orientation[[y0 + 1, y1 - 2], columns] = np.pi / 2
    return index_windows(magnitude, group_edges(magnitude, orientation, 1.0, 2.0), 1.5)


@pytest.mark.parametrize(
    ("finest", "off", "moves", "closest"), [(24, 9, True, 4), (24, 1, False, 4), (0, 9, True, 3), (0, 1, False, 3)]
)
def test_refinement_finds_an_outline_to_the_finest_move_and_no_closer(finest, off, moves, closest):
    true = np.array([[100, 60, 196, 132]], np.int32)
    index = outline(*true[0])
    given = true + off * np.array([[-1, -1, 1, 1]], np.int32)
    score = np.array([score_window(index, *given[0], np.float32(0))], np.float32)
    found, better = given.copy(), score.copy()
    refine(index, found, better, np.float32(1 / 3), finest)
    assert (better > score).all() == moves
    assert (found != given).any() == moves
    assert np.abs(found - true).max() <= closest
