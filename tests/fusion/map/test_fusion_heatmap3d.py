"""The bounded point map: what goes when it is full, and that everything left is still found."""

import numpy as np
import pytest

from spot3d.fusion.map.heatmap3d import Heatmap3D
from spot3d.fusion.map.map_arrays import FREQUENCY, HEAT, LAST, X, key_at, remove_key
from spot3d.voxel_hash import find_slot

PER_METRE = np.float32(1 / 0.008)


def filled(points: np.ndarray, heat: np.ndarray, frequency: np.ndarray, last: np.ndarray) -> Heatmap3D:
    heatmap = Heatmap3D(limit=len(points), voxel=0.008)
    known = heatmap.arrays
    rows = known.rows
    rows[:] = 0
    rows[:, X : X + 3], rows[:, HEAT], rows[:, FREQUENCY], known.numbers[:, LAST] = points, heat, frequency, last
    for row, point in enumerate(points):
        key = key_at(*point, PER_METRE)
        slot = find_slot(known.keys, key)
        known.keys[slot], known.slot_rows[slot], known.row_slots[row] = key, row, slot
    known.counts[0] = len(points)
    return heatmap


def scattered(count: int, seed: int = 0) -> np.ndarray:
    """Points in as many different voxels."""
    voxels = np.random.default_rng(seed).permutation(20**3)[:count]
    return (0.008 * (np.stack(np.unravel_index(voxels, (20,) * 3), 1) - 9.5)).astype(np.float32)


def row_at(heatmap: Heatmap3D, point: np.ndarray) -> int:
    known = heatmap.arrays
    slot = find_slot(known.keys, key_at(*point, PER_METRE))
    return int(known.slot_rows[slot]) if known.keys[slot] >= 0 else -1


def assert_consistent(heatmap: Heatmap3D) -> None:
    taken, known = np.flatnonzero(heatmap.points()[:, FREQUENCY] > 0), heatmap.arrays
    assert heatmap.count == len(taken) == np.count_nonzero(known.keys >= 0)
    assert [row_at(heatmap, known.rows[row, :3]) for row in taken] == taken.tolist()
    np.testing.assert_array_equal(known.slot_rows[known.row_slots[taken]], taken)
    free = known.free[: heatmap.free_count]
    np.testing.assert_array_equal(np.sort(free), np.flatnonzero(heatmap.points()[:, FREQUENCY] == 0))


@pytest.mark.parametrize("wanted", [0, 1, 150, 200, 1000])
def test_after_eviction_every_point_that_is_left_is_found_by_its_voxel(wanted: int) -> None:
    count = 1000
    rng = np.random.default_rng(1)
    heatmap = filled(scattered(count), rng.uniform(0, 5, count), rng.integers(5, 9, count), rng.integers(1, 9, count))
    freed = heatmap.evict(wanted, tau=10.0)
    assert freed == min(wanted, count // 5) == count - heatmap.count == heatmap.evicted
    assert_consistent(heatmap)


def test_the_cold_go_first_and_of_equals_the_oldest() -> None:
    heat = np.repeat([0.0, 0.0, 8.0], 200)
    last = np.repeat([1, 50, 50], 200)
    heatmap = filled(scattered(600), heat, np.full(600, 10), last)
    gone = [heatmap.evict(100, tau=10.0) for _ in range(4)]
    assert gone[:2] == [100, 100]
    assert (heatmap.points()[:200, FREQUENCY] == 0).all()
    assert sum(gone) > 250
    assert (heatmap.points()[400:, FREQUENCY] > 0).all()


def test_eviction_goes_on_where_it_ended() -> None:
    heatmap = filled(scattered(1000), np.zeros(1000), np.ones(1000), np.ones(1000))
    for _ in range(3):
        heatmap.evict(100, tau=10.0)
    assert (heatmap.points()[:300, FREQUENCY] == 0).all()
    assert (heatmap.points()[300:, FREQUENCY] == 1).all()


def test_points_in_the_room_of_those_that_went_are_not_the_next_to_go() -> None:
    heatmap = filled(scattered(1000), np.zeros(1000), np.ones(1000), np.ones(1000))
    heatmap.evict(100, tau=10.0)
    heatmap.arrays.counts[1] = 0  # other points have taken the rows
    heatmap.arrays.row_slots[:100], heatmap.points()[:100, FREQUENCY] = -1, 1
    heatmap.evict(100, tau=10.0)
    assert (heatmap.points()[100:200, FREQUENCY] == 0).all()
    assert np.count_nonzero(heatmap.points()[:, FREQUENCY]) == 900


def test_of_points_that_are_all_alike_a_fifth_goes_at_most() -> None:
    heatmap = filled(scattered(1000), np.zeros(1000), np.ones(1000), np.ones(1000))
    assert heatmap.evict(1000, tau=10.0) == 200


@pytest.mark.parametrize("seed", range(8))
def test_what_was_held_is_restored_in_place_of_what_there_was(seed: int) -> None:
    """In tables of sixteen slots, so that the first of them has its turn."""
    points = scattered(8, seed)
    held = filled(points, np.ones(8), np.ones(8), np.ones(8)).held()
    other = filled(scattered(8, seed + 100), np.ones(8), np.ones(8), np.ones(8))
    other.evict(1, tau=10.0)
    other.restore(*held)
    assert [row_at(other, point) for point in points] == list(range(8))
    for count in range(8, 4, -1):
        assert other.count == count
        assert_consistent(other)
        other.evict(1, tau=10.0)


def test_keys_that_share_a_place_are_found_after_one_of_them_has_gone() -> None:
    rng = np.random.default_rng(2)
    keys, slot_rows = np.full(64, -1), np.zeros(64, np.int32)
    row_slots, names = np.zeros(48, np.int32), rng.permutation(10**6)[:48]
    for row, key in enumerate(names):  # three quarters full: most keys are not at their own place
        slot = find_slot(keys, key)
        keys[slot], slot_rows[slot], row_slots[row] = key, row, slot
    left = set(range(48))
    for row in rng.permutation(48):
        remove_key(np.uint64(row_slots[row]), keys, slot_rows, row_slots)
        left.remove(row)
        assert np.count_nonzero(keys >= 0) == len(left)
        assert all(keys[find_slot(keys, names[k])] == names[k] for k in left)
        assert all(slot_rows[row_slots[k]] == k for k in left)


def test_clear_forgets_all() -> None:
    heatmap = filled(scattered(50), np.ones(50), np.ones(50), np.ones(50))
    point = heatmap.points()[49, :3].copy()
    heatmap.evict(5, tau=10.0)
    assert row_at(heatmap, point) == 49
    heatmap.clear()
    assert (heatmap.count, heatmap.evicted, row_at(heatmap, point)) == (0, 0, -1)


@pytest.mark.parametrize("metres", [0.0, 1.0, -3.0, 400.0])
def test_neighbouring_voxels_have_different_keys(metres: float) -> None:
    edge = np.float32(0.125)  # exact in binary, so that borders are where they should be
    steps = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3), -1).reshape(-1, 3)
    points = (np.float32(metres) + (steps + 0.5) * edge).astype(np.float32)
    assert len({int(key_at(*point, np.float32(1 / edge))) for point in points}) == 27
