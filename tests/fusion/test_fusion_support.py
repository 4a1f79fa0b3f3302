"""What level sheets do to the boxes at them."""

import numpy as np
import pytest
from fusion_room import STAGE, TABLE_PLANE, Cuboid, rotation_z, sampled

from spot3d.boxes import Box3D
from spot3d.fusion.selection import MapPoints
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.sheet import find_sheets
from spot3d.fusion.support import Support, crossed_by, edge_groups, find_supports, is_rim, standing
from spot3d.fusion.support_kernels import count_foreign, count_touching, on_long_sides, spread_about
from spot3d.fusion.surface import gather_cells

SETTINGS = FusionSettings()
UP = np.array([0.0, 0.0, 1.0])
NOBODY = np.zeros(0, np.int32)


def table(noise: float = 0.0) -> list[Support]:
    """The supports of a room whose points are `noise` metres (standard deviation) off their surfaces."""
    points = sampled(STAGE)
    z = points.xyz + np.random.default_rng(0).normal(0, 1, (len(points), 1)) * points.normal * noise
    noisy = MapPoints(z.astype(np.float32), points.normal, points.colour, points.heat, points.frequency)
    _, coarse = gather_cells(noisy.xyz, noisy.normal, noisy.heat, 0.005)
    return find_supports(noisy, coarse, find_sheets(coarse, [TABLE_PLANE], SETTINGS), UP, SETTINGS)


def upright(x: float, bottom: float, size: tuple[float, float, float]) -> Box3D:
    return Cuboid((x, 0.0, bottom + size[2] / 2), size).box()


@pytest.mark.parametrize(("noise", "clearance"), [(0.0, 0.005), (0.004, 0.012)])
def test_a_box_ends_above_the_noise_of_its_support(noise: float, clearance: float) -> None:
    box = standing(upright(0.0, 0.02, (0.1, 0.1, 0.2)), table(noise))
    assert box.centre[2] - box.size[2] / 2 == pytest.approx(clearance, abs=0.002)
    assert box.centre[2] + box.size[2] / 2 == pytest.approx(0.22, abs=1e-9)


def test_a_flat_thing_keeps_most_of_its_height() -> None:
    box = standing(upright(0.0, 0.01, (0.1, 0.1, 0.01)), table(noise=0.004))
    assert box.size[2] == pytest.approx(0.85 * 0.02, abs=0.001)


def test_what_hangs_above_or_below_a_support_keeps_its_box() -> None:
    for bottom in (0.1, -0.4):
        box = upright(0.0, bottom, (0.1, 0.1, 0.2))
        assert standing(box, table()) is box


@pytest.mark.parametrize(
    ("name", "box", "crossed"),
    [
        ("through the table", upright(0.0, -0.3, (0.4, 0.4, 0.6)), True),
        ("on it", upright(0.0, 0.0, (0.4, 0.4, 0.6)), False),
        ("below it", upright(0.0, -0.7, (0.4, 0.4, 0.6)), False),
        ("beside it", upright(1.0, -0.3, (0.4, 0.4, 0.6)), False),
    ],
)
def test_a_support_runs_through_a_box(name: str, box: Box3D, crossed: bool) -> None:
    assert (crossed_by(box, NOBODY, table()) is not None) == crossed, name


def test_cells_of_the_object_itself_are_no_support() -> None:
    (support,) = table()
    assert crossed_by(upright(0.0, -0.3, (0.4, 0.4, 0.6)), support.cells.astype(np.int32), [support]) is None


@pytest.mark.parametrize(("name", "bottom", "rim"), [("its own front", -0.03, True), ("a drawer", -0.3, False)])
def test_the_front_of_a_board_is_its_own(name: str, bottom: float, rim: bool) -> None:
    """The table ends at y = -0.6."""
    z = np.arange(bottom + 0.015, 0.0, 0.03)
    own = np.stack(np.meshgrid(np.arange(-0.3, 0.3, 0.03), [-0.6], z), -1).reshape(-1, 3).astype(np.float32)
    box = Cuboid((0.0, -0.6, bottom / 2), (0.6, 0.02, -bottom)).box()
    twice = np.tile(np.arange(len(own), dtype=np.int32), 2)
    assert is_rim(box, twice, np.append(own, np.float32([[9, 9, 9]]), axis=0), table()) == rim, name


def test_what_touches_is_counted_as_by_brute_force() -> None:
    points, others = np.random.default_rng(1).random((2, 200, 3), np.float32)
    gap = np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)
    assert count_touching(points, others, 0.1) == np.count_nonzero(gap < 0.1)
    assert count_touching(points, others[:0], 0.1) == 0


@pytest.mark.parametrize(
    ("name", "upper", "lower", "groups"),
    [
        ("a chair's back at the edge", (0.73, (0.06, 0.4, 0.2)), (0.74, (0.06, 0.36, 0.3)), [[0, 1]]),
        ("what stands on the table over something", (0.60, (0.1, 0.1, 0.1)), (0.61, (0.1, 0.1, 0.3)), [[0], [1]]),
        ("something else beneath the edge", (0.73, (0.06, 0.4, 0.2)), (0.55, (0.2, 0.2, 0.3)), [[0], [1]]),
        ("far from any table", (1.40, (0.06, 0.4, 0.2)), (1.41, (0.06, 0.36, 0.3)), [[0], [1]]),
    ],
)
def test_what_goes_on_beneath_a_thing_at_the_edge_is_part_of_it(
    name: str,
    upper: tuple[float, tuple[float, float, float]],
    lower: tuple[float, tuple[float, float, float]],
    groups: list[list[int]],
) -> None:
    boxes = [upright(upper[0], 0.01, upper[1]), upright(lower[0], -0.05 - lower[1][2], lower[1])]
    rng = np.random.default_rng(0)
    inside = [(box.centre + rng.uniform(-0.5, 0.5, (200, 3)) * box.size).astype(np.float32) for box in boxes]
    assert edge_groups(boxes, inside, table()) == groups, name


def test_the_spread_about_a_sheet_is_that_of_its_points() -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.5, 0.5, (5000, 3)).astype(np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (5000, 1)) * rng.choice([-1, 1], (5000, 1)).astype(np.float32)
    cell, on = rng.integers(0, 9, 5000).astype(np.int32), np.arange(9) % 2 == 0
    plane = np.array([0, 0, 1.0, 0.1]), np.eye(3)[:2], np.zeros(3), np.zeros(6)
    rows = np.arange(0, 5000, 3)
    z = points[rows[on[cell[rows]] & (normals[rows, 2] > 0)], 2].astype(np.float64)
    spread = spread_about(points, normals, cell, on, 3, *plane)
    assert spread == pytest.approx(np.median(np.abs(z - np.median(z))))
    assert spread_about(points, normals, cell, np.zeros(9, bool), 3, *plane) == 0


def test_what_is_inside_and_beside_a_box_is_counted_as_by_the_plain_formula() -> None:
    rng = np.random.default_rng(3)
    points, cells = rng.uniform(-1, 1, (3000, 3)).astype(np.float32), rng.integers(0, 3000, 3000)
    own = rng.integers(0, 5000, 900).astype(np.int32)
    box = Box3D(np.array([0.1, 0.2, 0.3]), np.array([0.9, 0.5, 0.7]), rotation_z(0.4))
    local = (points - box.centre) @ box.rotation
    inside = (np.abs(local) < box.size / 2).all(axis=1) & ~np.isin(cells, own)
    assert count_foreign(points, cells, own, box.centre, box.rotation, box.size) == np.count_nonzero(inside)
    over = local[(np.abs(local[:, :2]) < box.size[:2] / 2 + 0.1).all(axis=1), 1] > 0
    counted = on_long_sides(points, box.centre, box.rotation, box.size, 0.1)
    assert counted == (np.count_nonzero(~over), np.count_nonzero(over))
