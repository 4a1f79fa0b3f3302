"""Cells of a surface and the pairs of near ones, against brute force."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from spot3d.fusion.surface import cells_around, gather_cells, near_pairs, points_of_cells

EDGE = 0.125  # exact in binary: cells are where plain division says


def cloud(count: int, seed: int, spread: float = 1.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-spread, spread, (count, 3)).astype(np.float32)


def ordered(pairs: np.ndarray) -> set[tuple[int, int]]:
    return {(int(min(pair)), int(max(pair))) for pair in pairs}


@pytest.mark.parametrize(("count", "spread"), [(0, 1.0), (1, 1.0), (50, 0.4), (600, 1.0), (3000, 0.3), (500, 5.0)])
def test_cells_and_pairs_are_complete(count: int, spread: float) -> None:
    points = cloud(count, count, spread)
    surface = gather_cells(points, np.ones_like(points), np.ones(count, np.float32), EDGE)
    keys, cells = np.unique(np.floor(points / EDGE).astype(int).reshape(-1, 3), axis=0, return_inverse=True)
    assert len(surface.centre) == len(keys)
    ours = np.zeros(len(keys), int)
    ours[cells.ravel()] = surface.cell_of_point  # unique's numbering to ours
    np.testing.assert_array_equal(ours[cells.ravel()], surface.cell_of_point)
    expected = cKDTree(keys).query_pairs(2.0 + 1e-9) if len(keys) else set()
    pairs = near_pairs(surface)
    assert ordered(pairs) == {(min(ours[a], ours[b]), max(ours[a], ours[b])) for a, b in expected}
    assert len(pairs) == len(expected)


def test_cells_hold_the_means_of_their_points() -> None:
    points = np.array([[0.01, 0.01, 0.01], [0.03, 0.05, 0.07], [-0.01, 0, 0]], np.float32)
    normals = np.array([[0, 0, 3], [0, 4, 0], [0, 0, 0]], np.float32)
    surface = gather_cells(points, normals, np.array([0.2, 0.4, 0.9], np.float32), EDGE)
    np.testing.assert_array_equal(surface.cell_of_point, [0, 0, 1])
    np.testing.assert_allclose(surface.centre, [[0.02, 0.03, 0.04], [-0.01, 0, 0]], atol=1e-7)
    np.testing.assert_allclose(surface.normal, [[0, 0.8, 0.6], [0, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(surface.heat, [0.3, 0.9], atol=1e-6)


def test_points_that_are_too_cold_belong_to_no_cell() -> None:
    points, heat = cloud(400, 2, 0.5), np.random.default_rng(2).random(400, np.float32)
    surface = gather_cells(points, np.ones_like(points), heat, EDGE, 0.4)
    warm = heat >= np.float32(0.4)
    alone = gather_cells(points[warm], np.ones_like(points[warm]), heat[warm], EDGE)
    assert (surface.cell_of_point[~warm] == -1).all()
    np.testing.assert_array_equal(surface.cell_of_point[warm], alone.cell_of_point)
    np.testing.assert_array_equal(surface.centre, alone.centre)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_pairs_of_members_are_those_of_all_that_have_two(share: float) -> None:
    points = cloud(400, 1, 0.5)
    surface = gather_cells(points, np.ones_like(points), np.ones(400, np.float32), EDGE)
    member = np.random.default_rng(0).random(len(surface.centre)) < share
    pairs = near_pairs(surface)
    assert ordered(near_pairs(surface, member)) == ordered(pairs[member[pairs].all(axis=1)])


def test_cells_of_a_coarser_surface_hold_the_same_points() -> None:
    points = cloud(500, 3)
    normals, heat = np.ones_like(points), np.random.default_rng(3).random(500, np.float32)
    fine = gather_cells(points, normals, heat, EDGE, 0.5)
    coarse = gather_cells(points, normals, heat, 2 * EDGE)
    held = fine.cell_of_point >= 0
    around = cells_around(fine, coarse)
    np.testing.assert_array_equal(around[fine.cell_of_point[held]], coarse.cell_of_point[held])


@pytest.mark.parametrize("groups", [0, 1, 5])
def test_points_of_groups_of_cells_are_in_their_order(groups: int) -> None:
    points, heat = cloud(300, 4), np.random.default_rng(4).random(300, np.float32)
    surface = gather_cells(points, np.ones_like(points), heat, EDGE, 0.2)
    group = np.random.default_rng(5).integers(-1, groups, len(surface.centre)).astype(np.int32)
    of_point = np.append(group, np.int32(-1))[surface.cell_of_point]
    found = points_of_cells(surface, group, groups)
    assert len(found) == groups
    for number, rows in enumerate(found):
        np.testing.assert_array_equal(rows, np.flatnonzero(of_point == number))
