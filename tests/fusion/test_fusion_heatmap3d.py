"""The bounded point map: what goes when it is full, and that everything left is still found."""

import numpy as np
import pytest

from spot3d.fusion.heatmap3d import FREQUENCY, HEAT, LAST, Heatmap3D, X, find_slot, voxel_key


def filled(points: np.ndarray, heat: np.ndarray, frequency: np.ndarray, last: np.ndarray) -> Heatmap3D:
    heatmap = Heatmap3D(limit=4000, voxel=0.008)
    rows = np.zeros((len(points), 16), np.float32)
    rows[:, X : X + 3], rows[:, HEAT], rows[:, FREQUENCY], rows[:, LAST] = points, heat, frequency, last
    heatmap.rows[: len(points)] = rows
    heatmap.count = len(points)
    return heatmap


def scattered(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.2, 0.2, (count, 3)).astype(np.float32)


def row_at(heatmap: Heatmap3D, point: np.ndarray) -> int:
    slot = find_slot(heatmap.keys, voxel_key(*point, np.float32(1 / heatmap.voxel)))
    return int(heatmap.slot_rows[slot]) if heatmap.keys[slot] >= 0 else -1


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 1.0])
def test_after_eviction_every_point_is_found_by_its_voxel(share: float) -> None:
    count = 1000
    rng = np.random.default_rng(1)
    heatmap = filled(scattered(count), rng.uniform(0, 5, count), rng.integers(5, 9, count), rng.integers(1, 9, count))
    before = heatmap.points().copy()
    moved = heatmap.evict(share, tau=10.0)
    assert heatmap.count == count - int(share * count) == np.count_nonzero(moved >= 0)
    assert heatmap.evicted == count - heatmap.count
    np.testing.assert_array_equal(heatmap.points()[moved[moved >= 0]], before[moved >= 0])
    for row in heatmap.points():
        other = heatmap.points()[row_at(heatmap, row[:3])]
        np.testing.assert_array_equal(np.floor(other[:3] / 0.008), np.floor(row[:3] / 0.008))


def test_the_cold_go_first_and_of_equals_the_oldest() -> None:
    heat = np.repeat([0.0, 0.0, 8.0], 100)
    last = np.repeat([1, 50, 50], 100)
    heatmap = filled(scattered(300), heat, np.full(300, 10), last)
    assert (heatmap.evict(1 / 3 + 1e-6, tau=10.0)[:100] == -1).all()
    assert (heatmap.evict(1 / 2 + 1e-6, tau=10.0)[:100] == -1).all()
    assert (heatmap.points()[:, HEAT] == 8).all()


def test_clear_forgets_all() -> None:
    heatmap = filled(scattered(50), np.ones(50), np.ones(50), np.ones(50))
    heatmap.evict(0.2, tau=10.0)
    point = heatmap.points()[0, :3].copy()
    assert row_at(heatmap, point) >= 0
    heatmap.clear()
    assert (heatmap.count, heatmap.evicted, row_at(heatmap, point)) == (0, 0, -1)


@pytest.mark.parametrize("metres", [0.0, 1.0, -3.0, 400.0])
def test_neighbouring_voxels_have_different_keys(metres: float) -> None:
    edge = np.float32(0.125)  # exact in binary, so that borders are where they should be
    steps = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3), -1).reshape(-1, 3)
    points = (np.float32(metres) + (steps + 0.5) * edge).astype(np.float32)
    assert len({int(voxel_key(*point, np.float32(1 / edge))) for point in points}) == 27
