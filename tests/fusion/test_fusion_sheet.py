"""Supporting planes as the map holds them: slightly warped, and not lifted by what stands on them."""

import numpy as np
import pytest
from fusion_room import BACKDROP_PLANE, STAGE, TABLE_PLANE, THREE, Cuboid, sampled, standing
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.sheet import Sheet, StructureSheet, find_sheets, fit_sheet, lying_flat, on_sheets
from spot3d.fusion.sheet_kernels import cells_at_sheet, in_long_groups, with_neighbours
from spot3d.fusion.structure import StructurePlane
from spot3d.fusion.surface import Surface, gather_cells

SETTINGS = FusionSettings()
PLANE = np.array([0.0, 0.0, 1.0, 0.0])


def warped_table(seed: int, objects: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a table with a bend of 8 mm and 2 mm of noise, their normals, and which are the table's."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.6, 0.6, (8000, 2))
    z = 0.008 * (xy[:, 0] / 0.6) ** 2 - 0.004 * xy[:, 1] / 0.6 + rng.normal(0, 0.002, 8000)
    xyz, of_table = np.column_stack((xy, z)), np.ones(8000, bool)
    if objects:  # books: their tops face as the table does, within reach of its plane
        of_table = ~((np.abs(xy[:, 0]) < 0.25) & (np.abs(xy[:, 1] - 0.1) < 0.2))
        xyz[~of_table, 2] += 0.02
    return xyz.astype(np.float32), np.tile(np.float32([0, 0, 1]), (8000, 1)), of_table


@pytest.mark.parametrize("objects", [False, True])
def test_a_warped_sheet_is_followed_whatever_lies_on_it(objects: bool) -> None:
    xyz, normals, of_table = warped_table(0, objects)
    sheet = fit_sheet(PLANE, xyz, normals, 0.03, warped=True)
    assert sheet is not None
    distance = sheet.distance(xyz)
    assert np.sqrt(np.mean(distance[of_table] ** 2)) < 0.003
    if objects:
        assert np.median(distance[~of_table]) > 0.015


def test_a_rigid_sheet_keeps_the_bend_as_its_spread() -> None:
    xyz, normals, _ = warped_table(1, objects=False)
    rigid, bent = (fit_sheet(PLANE, xyz, normals, 0.03, warped=warped) for warped in (False, True))
    assert rigid is not None
    assert bent is not None
    assert not rigid.warp[3:].any()
    assert bent.spread < rigid.spread


@pytest.mark.parametrize(
    ("name", "height", "facing"), [("too far", 0.2, 1.0), ("the other side", 0.0, -1.0), ("upright", 0.0, 0.0)]
)
def test_without_points_near_that_face_its_way_there_is_no_sheet(name: str, height: float, facing: float) -> None:
    xyz, normals, _ = warped_table(2, objects=False)
    assert fit_sheet(PLANE, xyz + np.float32([0, 0, height]), normals * np.float32(facing), 0.03, True) is None, name


def test_no_points_no_sheet() -> None:
    assert fit_sheet(PLANE, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), 0.03, True) is None


def cells_of_stage() -> tuple[Surface, Surface]:
    points = sampled(STAGE + THREE)
    return gather_cells(points.xyz, points.normal, points.heat, 0.005)


def test_table_and_wall_are_structure_and_objects_are_not() -> None:
    fine, coarse = cells_of_stage()
    sheets = find_sheets(coarse, [TABLE_PLANE, BACKDROP_PLANE], SETTINGS)
    assert len(sheets) == 2
    structure = on_sheets(fine, sheets)
    hot = fine.heat > 0.4
    high = hot & (fine.centre[:, 2] > 0.012)
    assert structure[~hot & (np.abs(fine.centre[:, 2]) < 0.004) & (fine.normal[:, 2] > 0.9)].all()
    assert structure[(fine.centre[:, 1] > 0.69) & (fine.normal[:, 1] < -0.99)].mean() > 0.95
    assert not structure[high].any()


def test_the_sides_of_a_board_are_structure_and_what_stands_beside_it_is_not() -> None:
    beside = Cuboid((0.9, 0.0, 0.0), (0.1, 0.2, 0.4), heat=1.0)
    points = sampled((*STAGE, beside))
    fine, coarse = gather_cells(points.xyz, points.normal, points.heat, 0.006)
    structure = on_sheets(fine, find_sheets(coarse, [TABLE_PLANE], SETTINGS))
    x, y, z = fine.centre.T
    assert structure[(z < -0.005) & (z > -0.038) & (np.abs(y + 0.6) < 0.002)].all()
    assert not structure[x > 0.8].any()


def test_a_plane_that_the_map_no_longer_shows_is_no_sheet() -> None:
    _, coarse = cells_of_stage()
    gone = StructurePlane(np.array([0, 0, 1.0, -0.4]), removed_share=1.0, heat=5.0)
    assert find_sheets(coarse, [gone], SETTINGS) == []


def test_a_small_plane_that_was_never_removed_is_an_objects_face() -> None:
    points = sampled((*STAGE, standing(0, 0, (0.4, 0.3, 0.2))))
    _, coarse = gather_cells(points.xyz, points.normal, points.heat, 0.005)
    top = StructurePlane(np.array([0, 0, 1.0, -0.2]), removed_share=0.0, heat=0.0)
    assert find_sheets(coarse, [top], SETTINGS) == []


def tilted_sheet() -> Sheet:
    rng = np.random.default_rng(7)
    axes = np.array([[2.0, 0, 0.4], [0, 3.0, 0]])
    return Sheet(np.array([-0.196, 0, 0.98, 0.05]), axes, rng.normal(0, 0.1, 3), rng.normal(0, 0.005, 6), 0.002)


def plain_distance(sheet: Sheet, points: np.ndarray) -> np.ndarray:
    x, y = np.clip((points - sheet.middle) @ sheet.axes.T, -1, 1).T
    warp = np.stack((np.ones_like(x), x, y, x * x, x * y, y * y), axis=1) @ sheet.warp
    return points @ sheet.plane[:3] + sheet.plane[3] - warp


def test_distances_and_what_follows_from_them_are_the_plain_formula() -> None:
    rng, sheet = np.random.default_rng(8), tilted_sheet()
    points = rng.uniform(-1, 1, (4000, 3)).astype(np.float32)
    points[:, 2] = 0.2 * points[:, 0] - 0.05 + rng.normal(0, 0.02, 4000)
    normals = (rng.normal(0, 0.5, (4000, 3)) + sheet.plane[:3]).astype(np.float32)
    surface, coarse = gather_cells(points, normals, np.ones(4000, np.float32), 0.008)
    distance, facing = plain_distance(sheet, surface.centre), surface.normal @ sheet.plane[:3]
    np.testing.assert_allclose(sheet.distance(surface.centre), distance, atol=1e-12)
    assert sheet.distance_of(surface.centre[7].astype(np.float64)) == pytest.approx(distance[7])
    block = surface.blocks.of_cells()
    kind = rng.integers(0, 9, len(surface.blocks))
    item = StructureSheet(sheet, 0.01, kind % 3 > 0, kind > 6)
    off = np.abs(distance)
    expected = item.cells[block] & (off < 0.01) & ((facing > 0.7) | (off < 0.005))
    expected |= item.near[block] & (distance > -0.04) & (distance < 0)
    np.testing.assert_array_equal(on_sheets(surface, [item]), expected)
    near = cells_at_sheet(surface.centre, surface.normal, 0.02, *sheet.shape)
    np.testing.assert_array_equal(near, (off < 0.02, (off < 0.02) & (facing > 0.7)))
    flat = (facing > 0.9) & (distance > 0) & (distance < 0.03)
    np.testing.assert_array_equal(lying_flat(surface, coarse, [(sheet, surface.centre)]), flat)


def test_beyond_a_shelf_nothing_lies_on_it() -> None:
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-1, 1, 0.02), np.arange(-1, 1, 0.02)))
    tops = np.stack((x, y, np.full_like(x, 0.02)), axis=1).astype(np.float32)
    up = np.tile(np.float32([0, 0, 1]), (len(tops), 1))
    surface, coarse = gather_cells(tops, up, np.ones(len(tops), np.float32), 0.008)
    along = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0]])  # a shelf of 1 m by 0.2 m, at an angle
    shelf = np.array([[a, b] for a in np.linspace(-0.5, 0.5, 50) for b in np.linspace(-0.1, 0.1, 10)]) @ along
    sheet = Sheet(np.array([0.0, 0, 1, 0]), along / 0.5, np.zeros(3), np.zeros(6), 0.002)
    beside = np.abs(surface.centre @ along.T)
    clear = (np.abs(beside - (0.55, 0.11)) > 1e-3).all(axis=1)
    flat = lying_flat(surface, coarse, [(sheet, shelf.astype(np.float32))])
    np.testing.assert_array_equal(flat[clear], (beside < (0.55, 0.11)).all(axis=1)[clear])


@pytest.mark.parametrize("warped", [False, True])
def test_a_fit_is_the_plain_reweighted_least_squares(warped: bool) -> None:
    xyz, normals, _ = warped_table(3, objects=True)
    sheet = fit_sheet(PLANE, xyz, normals, 0.03, warped)
    assert sheet is not None
    near = xyz[np.abs(xyz[:, 2]) < 0.03].astype(np.float64)
    x, y = np.clip((near - sheet.middle) @ sheet.axes.T, -1, 1).T
    terms = np.stack((np.ones_like(x), x, y, x * x, x * y, y * y), axis=1)[:, : 6 if warped else 3]
    warp, scale = np.zeros(terms.shape[1]), 0.015
    for _ in range(6):
        weight = np.clip(1 - ((near[:, 2] - terms @ warp) / (3 * scale)) ** 2, 0, None) ** 2
        square = (terms * weight[:, None]).T @ terms + 1e-3 * len(near) * np.eye(len(warp))
        warp = np.linalg.solve(square, (terms * weight[:, None]).T @ near[:, 2])
        off = np.abs(near[:, 2] - terms @ warp)
        scale = max(1e-3, 1.4826 * np.median(off[off < 3 * scale]))
    np.testing.assert_allclose(sheet.warp[: len(warp)], warp, atol=1e-9)
    assert sheet.spread == pytest.approx(scale)


def test_the_cells_near_to_each_of_several_sets_are_marked() -> None:
    rng = np.random.default_rng(5)
    pairs = rng.integers(0, 300, (200, 2)).astype(np.uint32)
    member = rng.random((300, 11)) < 0.2
    expected = member.copy()
    for i, j in pairs:
        expected[i] |= member[j]
        expected[j] |= member[i]
    near = with_neighbours(pairs, np.packbits(np.ascontiguousarray(member.T), axis=0))
    np.testing.assert_array_equal(np.unpackbits(near, axis=0, count=11).T, expected)


@pytest.mark.parametrize("seed", range(5))
def test_a_group_is_long_from_corner_to_corner(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre, member = rng.uniform(0, 0.5, (200, 3)).astype(np.float32), rng.random(200) < 0.5
    pairs = np.sort(rng.integers(0, 200, (150, 2)), axis=1).astype(np.uint32)
    pairs = pairs[np.argsort(pairs[:, 0])]
    joined = pairs[member[pairs].all(axis=1)]
    graph = csr_array((np.ones(len(joined)), joined.T), (200, 200))
    _, group = connected_components(graph, directed=False)
    length = np.array([np.linalg.norm(np.ptp(centre[group == number], axis=0)) for number in group])
    begin = np.searchsorted(pairs[:, 0], np.arange(201))
    found = in_long_groups(centre, pairs, begin, member, 0.5)
    np.testing.assert_array_equal(found, member & (length > 0.5))
    assert 0 < np.count_nonzero(found) < np.count_nonzero(member)
