"""Cells of a surface and the pairs of near ones, against brute force."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from spot3d.fusion.blocks import SIDE
from spot3d.fusion.surface import (
    gather_cells,
    mean_of_cells,
    middle_of,
    near_pairs,
    only,
    points_of_cells,
    rows_of_groups,
    sums_of_groups,
    taken,
)

EDGE = 0.125  # exact in binary: cells are where plain division says


def cloud(count: int, seed: int, spread: float = 1.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-spread, spread, (count, 3)).astype(np.float32)


def ordered(pairs: np.ndarray) -> set[tuple[int, int]]:
    return {(int(min(pair)), int(max(pair))) for pair in pairs}


@pytest.mark.parametrize(("count", "spread"), [(0, 1.0), (1, 1.0), (50, 0.4), (600, 1.0), (3000, 0.3), (500, 5.0)])
def test_cells_and_pairs_are_complete(count: int, spread: float) -> None:
    points = cloud(count, count, spread)
    surface, _ = gather_cells(points, np.ones_like(points), np.ones(count, np.float32), EDGE)
    keys, cells = np.unique(np.floor(points / EDGE).astype(int).reshape(-1, 3), axis=0, return_inverse=True)
    assert len(surface.centre) == len(keys)
    ours = np.zeros(len(keys), int)
    ours[cells.ravel()] = surface.cell_of_point  # unique's numbering to ours
    np.testing.assert_array_equal(ours[cells.ravel()], surface.cell_of_point)
    expected = cKDTree(keys).query_pairs(2.0 + 1e-9) if len(keys) else set()
    pairs = near_pairs(surface)
    assert ordered(pairs) == {(min(ours[a], ours[b]), max(ours[a], ours[b])) for a, b in expected}
    assert len(pairs) == len(expected)


def test_a_point_as_far_as_a_map_grid_reaches_ends_the_search_for_blocks() -> None:
    """There all bits of the packed place are ones, which means a free slot."""
    half = (1 << 20) // SIDE**2 * SIDE**2
    cells = np.array([[(1 << 22) - 1, (1 << 21) - 1, (1 << 21) - 1]]) * SIDE**2 + SIDE**2 // 2 - half
    points = (cells / 200).astype(np.float32)
    surface, _ = gather_cells(points, np.float32([[0, 0, 1]]), np.ones(1, np.float32), 0.005)
    assert len(surface.centre) == 1


def test_cells_hold_the_means_of_their_points() -> None:
    points = np.array([[0.01, 0.01, 0.01], [0.03, 0.05, 0.07], [-0.01, 0, 0]], np.float32)
    normals = np.array([[0, 0, 3], [0, 4, 0], [0, 0, 0]], np.float32)
    surface, _ = gather_cells(points, normals, np.array([0.2, 0.4, 0.9], np.float32), EDGE)
    np.testing.assert_array_equal(surface.cell_of_point, [0, 0, 1])
    np.testing.assert_allclose(surface.centre, [[0.02, 0.03, 0.04], [-0.01, 0, 0]], atol=1e-7)
    np.testing.assert_allclose(surface.normal, [[0, 0.8, 0.6], [0, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(surface.heat, [0.3, 0.9], atol=1e-6)


def test_points_that_are_too_cold_belong_to_no_cell() -> None:
    points, heat = cloud(400, 2, 0.5), np.random.default_rng(2).random(400, np.float32)
    surface, _ = gather_cells(points, np.ones_like(points), heat, EDGE, 0.4)
    warm = heat >= np.float32(0.4)
    alone, _ = gather_cells(points[warm], np.ones_like(points[warm]), heat[warm], EDGE)
    assert (surface.cell_of_point[~warm] == -1).all()
    assert len(surface.centre) == len(alone.centre)
    np.testing.assert_array_equal(surface.centre[surface.cell_of_point[warm]], alone.centre[alone.cell_of_point])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_of_some_cells_alone_nothing_changes_but_their_number(share: float) -> None:
    points, heat = cloud(400, 1, 0.5), np.random.default_rng(1).random(400, np.float32)
    surface, _ = gather_cells(points, points, heat, EDGE, 0.3)
    kept = np.random.default_rng(0).random(len(surface.centre)) < share
    part, number = only(surface, kept), np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
    pairs = near_pairs(surface)
    assert ordered(near_pairs(part)) == ordered(number[pairs[kept[pairs].all(axis=1)]])
    np.testing.assert_array_equal(part.cell_of_point, number[surface.cell_of_point])
    np.testing.assert_array_equal(part.blocks.of_cells(), surface.blocks.of_cells()[kept])
    for column in ("centre", "normal", "heat", "size"):
        np.testing.assert_array_equal(getattr(part, column), getattr(surface, column)[kept])


@pytest.mark.parametrize(("count", "spread"), [(0, 1.0), (500, 1.0), (500, 20.0)])
def test_blocks_are_the_cells_of_a_coarser_surface_of_all_points(count: int, spread: float) -> None:
    points, heat = cloud(count, 3, spread), np.random.default_rng(3).random(count, np.float32)
    fine, coarse = gather_cells(points, np.ones_like(points), heat, EDGE, 0.5)
    keys, cells = np.unique(np.floor(points / EDGE).astype(int).reshape(-1, 3) // SIDE, axis=0, return_inverse=True)
    assert coarse.edge == SIDE * EDGE
    assert len(coarse.centre) == len(keys)
    ours = np.zeros(len(keys), int)
    ours[cells.ravel()] = coarse.cell_of_point
    np.testing.assert_array_equal(ours[cells.ravel()], coarse.cell_of_point)
    np.testing.assert_array_equal(coarse.size, np.bincount(coarse.cell_of_point, minlength=len(keys)))
    np.testing.assert_allclose(
        coarse.heat, np.bincount(coarse.cell_of_point, heat, minlength=len(keys)) / coarse.size, atol=1e-6
    )
    held = fine.cell_of_point >= 0
    np.testing.assert_array_equal(fine.blocks.of_cells()[fine.cell_of_point[held]], coarse.cell_of_point[held])
    expected = cKDTree(keys).query_pairs(2.0 + 1e-9) if len(keys) else set()
    assert ordered(near_pairs(coarse)) == {(min(ours[a], ours[b]), max(ours[a], ours[b])) for a, b in expected}


@pytest.mark.parametrize("groups", [0, 1, 5])
def test_rows_of_groups_are_in_their_order(groups: int) -> None:
    rng = np.random.default_rng(5)
    member, group = rng.integers(-1, 40, 300).astype(np.int32), rng.integers(-1, groups, 40).astype(np.int32)
    found = rows_of_groups(member, np.bincount(member[member >= 0], minlength=40), group, groups)
    assert len(found) == groups
    for number, rows in enumerate(found):
        np.testing.assert_array_equal(rows, np.flatnonzero((member >= 0) & (group[member] == number)))


def test_points_of_groups_of_cells() -> None:
    points, heat = cloud(300, 4), np.random.default_rng(4).random(300, np.float32)
    surface, _ = gather_cells(points, np.ones_like(points), heat, EDGE, 0.2)
    groups = [np.arange(3, 40), np.array([60, 50]), np.zeros(0, np.int64)]
    for cells, rows in zip(groups, points_of_cells(surface, groups), strict=True):
        np.testing.assert_array_equal(rows, np.flatnonzero(np.isin(surface.cell_of_point, cells)))


def test_means_and_rows_are_the_plain_ones() -> None:
    points, rows = cloud(50, 6), np.array([3, 3, 49, 0, 7, 8])
    np.testing.assert_allclose(middle_of(points), points.mean(axis=0, dtype=np.float64))
    np.testing.assert_array_equal(middle_of(points[:0]), np.zeros(3))
    np.testing.assert_array_equal(taken(points, rows[::2]), points[rows[::2]])
    heat, size = points[:, 0].copy(), np.arange(1, 51, dtype=np.float32)
    assert mean_of_cells(heat, size, rows) == pytest.approx(np.average(heat[rows], weights=size[rows]))


def test_sums_of_groups_leave_out_what_is_in_none() -> None:
    size, total = sums_of_groups(np.array([2, -1, 0, 2], np.int32), np.array([1, 9, 5, 3], np.float32))
    np.testing.assert_array_equal(size, [1, 0, 2])
    np.testing.assert_array_equal(total, [5, 0, 4])
    assert [len(part) for part in sums_of_groups(np.zeros(0, np.int32), np.zeros(0, np.float32))] == [0, 0]
