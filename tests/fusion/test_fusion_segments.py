"""Surfaces are split at concave creases and nowhere else."""

import numpy as np
import pytest
from fusion_room import Cuboid, sampled, standing
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.fusion.components import in_good_part, refined, share_out
from spot3d.fusion.segments import concavity, connected_cells, smooth_normals, split_at_creases
from spot3d.fusion.surface import Surface, gather_cells, near_pairs, only

EDGE, CREASE, SMALLEST, SEAMED = 0.005, 10.0, 40, 300


def surface_of(xyz: np.ndarray, normal: np.ndarray) -> Surface:
    return gather_cells(xyz.astype(np.float32), normal.astype(np.float32), np.ones(len(xyz), np.float32), EDGE)[0]


def split(surface: Surface, flat: np.ndarray | None = None, seamed: int = SEAMED) -> np.ndarray:
    flat = np.zeros(len(surface.centre), bool) if flat is None else flat
    return split_at_creases(surface, flat, CREASE, SMALLEST, seamed)


def ball(radius: float, hollow: bool = False) -> tuple[np.ndarray, np.ndarray]:
    count = int(4 * np.pi * radius**2 / 0.002**2)
    z = 1 - (2 * np.arange(count) + 1) / count
    around = np.arange(count) * np.pi * (3 - np.sqrt(5))
    out = np.column_stack((np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z))
    return radius * out, -out if hollow else out


def box_surface(*cuboids: Cuboid) -> tuple[Surface, np.ndarray]:
    """The cuboids' cells, and which cuboid most of each cell's points are of (told by the red channel)."""
    points = sampled(cuboids, step=0.002)
    surface = surface_of(points.xyz, points.normal)
    owner = np.bincount(surface.cell_of_point, points.colour[:, 0]) / np.bincount(surface.cell_of_point)
    return surface, owner


@pytest.mark.parametrize(
    ("name", "surface", "sign"),
    [
        ("ball", surface_of(*ball(0.06)), -1),
        ("hollow", surface_of(*ball(0.06, hollow=True)), 1),
    ],
)
def test_concavity_is_the_mean_curvature(name: str, surface: Surface, sign: int) -> None:
    pairs = near_pairs(surface)
    bend, link = concavity(surface, surface.normal, pairs)
    assert np.median(bend) == pytest.approx(sign / 0.06, rel=0.15), name
    gap = np.linalg.norm(surface.centre[pairs[:, 0]] - surface.centre[pairs[:, 1]], axis=1)
    np.testing.assert_array_equal(link, pairs[gap < 1.6 * EDGE])


@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.8])
def test_a_convex_box_is_one(yaw: float) -> None:
    surface, _ = box_surface(standing(0.011, 0.023, (0.2, 0.12, 0.15), yaw))
    assert set(split(surface)) == {0}


@pytest.mark.parametrize("radius", [0.03, 0.06, 0.15])
def test_a_ball_is_one(radius: float) -> None:
    assert set(split(surface_of(*ball(radius)))) == {0}


BLACK, RED = (0, 0, 0), (200, 0, 0)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        pytest.param(
            standing(-0.05, 0, (0.1, 0.1, 0.1), colour=BLACK),
            standing(0.1, 0, (0.2, 0.26, 0.2), colour=RED),
            id="against a larger face",
        ),
        pytest.param(
            standing(-0.06, 0, (0.12, 0.1, 0.14), colour=BLACK),
            standing(0.05, 0, (0.1, 0.16, 0.2), colour=RED),
            id="a T",
        ),
        pytest.param(
            standing(0, 0, (0.24, 0.24, 0.1), 0.4, colour=BLACK),
            Cuboid((0.01, 0.02, 0.15), (0.1, 0.1, 0.1), 0.9, RED, heat=1.0),
            id="one on the other",
        ),
    ],
)
def test_two_boxes_that_touch_are_split_at_the_crease(first: Cuboid, second: Cuboid) -> None:
    surface, owner = box_surface(first, second)
    labels = split(surface)
    most = [np.bincount(labels[part]).argmax() for part in (owner < 20, owner > 180)]
    assert most[0] != most[1]
    assert np.mean(labels[owner < 20] == most[0]) > 0.9
    assert np.mean(labels[owner > 180] == most[1]) > 0.9


def valley(blur_in_the_middle: float, blur_at_the_ends: float) -> Surface:
    """Two slopes of 35 degrees that meet in a valley along y, rounded over so many metres."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-0.08, 0.08, 0.002), np.arange(-0.08, 0.08, 0.002)))
    blur = blur_at_the_ends + (blur_in_the_middle - blur_at_the_ends) * np.clip(1 - (y / 0.05) ** 2, 0, 1)
    slope = 0.7 * x / np.hypot(x, blur)
    normal = np.column_stack((-slope, np.zeros_like(x), np.ones_like(x))) / np.sqrt(1 + slope**2)[:, None]
    return surface_of(np.column_stack((x, y, 0.7 * (np.hypot(x, blur) - blur))), normal)


@pytest.mark.parametrize(
    ("name", "middle", "ends", "seamed", "count"),
    [
        ("sharp everywhere", 0.004, 0.004, SEAMED, 2),
        ("faint in the middle", 0.035, 0.004, SEAMED, 2),
        ("faint everywhere", 0.035, 0.035, SEAMED, 1),
        ("faint in the middle, of parts too small for that", 0.035, 0.004, 2000, 1),
        ("sharp everywhere, however small the parts", 0.004, 0.004, 2000, 2),
    ],
)
def test_a_crease_is_followed_where_it_is_faint(name: str, middle: float, ends: float, seamed: int, count: int) -> None:
    surface = valley(middle, ends)
    segments = split(surface, seamed=seamed)
    sides = [segments[surface.centre[:, 0] < -0.02], segments[surface.centre[:, 0] > 0.02]]
    assert [len(set(side)) for side in sides] == [1, 1], name
    assert len(set(np.concatenate(sides))) == count, name


def test_inside_and_outside_of_a_bowl_stay_whole_each() -> None:
    # Its inside bends by 1 / radius, which a crease must exceed.
    parts = [(xyz[xyz[:, 2] < 0], normal[xyz[:, 2] < 0]) for xyz, normal in (ball(0.16), ball(0.13, hollow=True))]
    surface = surface_of(*(np.concatenate(both) for both in zip(*parts, strict=True)))
    labels = split(surface)
    for side in (np.linalg.norm(surface.centre, axis=1) < 0.145, np.linalg.norm(surface.centre, axis=1) > 0.145):
        assert np.bincount(labels[side]).max() > 0.95 * side.sum()


def test_what_was_taken_out_parts_the_rest() -> None:
    surface, _ = box_surface(standing(0.0, 0.0, (0.3, 0.02, 0.02)))
    member = np.abs(surface.centre[:, 0]) > 0.02
    assert set(split(only(surface, member))) == {0, 1}


def test_what_lies_flat_is_a_region_of_its_own() -> None:
    surface, _ = box_surface(standing(0, 0, (0.3, 0.3, 0.01)))
    flat = surface.centre[:, 0] > 0
    labels = split(surface, flat=flat)
    assert set(labels[flat]).isdisjoint(labels[~flat])


def test_no_points_no_segments() -> None:
    assert len(split(surface_of(np.zeros((0, 3)), np.zeros((0, 3))))) == 0


def test_normals_are_smoothed_but_not_over_an_edge() -> None:
    surface, _ = box_surface(standing(0, 0, (0.2, 0.2, 0.2)))
    rng = np.random.default_rng(0)
    noisy = surface.normal + rng.normal(0, 0.08, surface.normal.shape).astype(np.float32)
    noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
    clean = np.abs(surface.normal).max(axis=1) > 0.999
    smooth = smooth_normals(noisy.astype(np.float32), near_pairs(surface))
    error = [np.mean((found[clean] - surface.normal[clean]) ** 2) for found in (noisy, smooth)]
    assert error[1] < 0.3 * error[0]


def test_a_label_spreads_ring_by_ring_and_the_lowest_wins() -> None:
    rng = np.random.default_rng(2)
    links = np.append(rng.integers(0, 290, (400, 2)), [[290, 291]], axis=0).astype(np.uint32)
    labels = np.where(rng.random(300) < 0.05, np.arange(300), -1).astype(np.int32)
    labels[290:] = -1
    expected = labels.copy()
    for _ in range(12):
        before = expected.copy()
        for a, b in np.concatenate((links, links[:, ::-1])):
            if before[a] < 0 <= before[b]:
                expected[a] = before[b] if expected[a] < 0 else min(expected[a], before[b])
    left = share_out(labels, links)
    np.testing.assert_array_equal(labels, expected)
    between = links[(labels[links] < 0).all(axis=1)]
    assert len(between) > 0
    assert set(map(tuple, between.tolist())) <= set(map(tuple, left.tolist()))


def test_parts_take_the_place_of_what_they_divide() -> None:
    whole = np.array([0, 0, 0, 1, 1, 2, -1, -1], np.int32)
    part = np.array([0, -1, 1, -1, -1, -1, 3, -1], np.int32)
    np.testing.assert_array_equal(refined(whole, part), [0, -1, 1, 5, 5, 6, 3, -1])


def test_the_members_of_a_tree_that_is_good_in_part() -> None:
    root = np.array([0, 0, 1, 3, 3, 5], np.uint32)  # the third cell's root is found by way of the second
    member, good = np.array([1, 1, 1, 1, 1, 0], bool), np.array([0, 0, 1, 0, 0, 1], bool)
    np.testing.assert_array_equal(in_good_part(root, member, good, 0.3), [1, 1, 1, 0, 0, 0])
    np.testing.assert_array_equal(in_good_part(root, member, good, 0.4), np.zeros(6))


def test_components_do_not_depend_on_the_order_of_the_links() -> None:
    rng = np.random.default_rng(1)
    links = rng.integers(0, 200, (150, 2)).astype(np.uint32)
    group = rng.choice(np.array([0, 1, 1, 1, 1, 2], np.uint8), 200)
    labels = connected_cells(links, group)
    joined = links[(group[links[:, 0]] == group[links[:, 1]]) & (group[links[:, 0]] > 0)]
    graph = csr_array((np.ones(len(joined)), joined.T), (200, 200))
    _, expected = connected_components(graph[group > 0][:, group > 0], directed=False)
    np.testing.assert_array_equal(labels[group > 0], expected)
    assert (labels[group == 0] == -1).all()
    large = np.bincount(expected) >= 3
    assert 0 < np.count_nonzero(large) < len(large)
    number = np.where(large, np.cumsum(large) - 1, -1)
    np.testing.assert_array_equal(connected_cells(links, group, 3)[group > 0], number[expected])
    np.testing.assert_array_equal(connected_cells(links[rng.permutation(150)][:, ::-1].copy(), group), labels)
