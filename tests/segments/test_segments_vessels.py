"""The inside and the outside of a vessel."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1
from spot3d.segments.vessels import _ring_of, _share_near, join_vessels

UP = np.array([0.0, 0.0, 1.0])
RADIUS, HEIGHT = 0.04, 0.1
Part = tuple[NDArray[np.float32], NDArray[np.float32]]


def arc(
    start: float, end: float, low: float, high: float, inside: bool, radius: float = RADIUS, x: float = 0.0
) -> Part:
    """Points and normals of the wall of an upright cylinder at (x, 0) between two angles, degrees, and two heights."""
    angle, z = (
        grid.ravel() for grid in np.meshgrid(np.deg2rad(np.arange(start, end, 5.0)), np.arange(low, high, 0.004))
    )
    outwards = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=1)
    points = radius * outwards + np.stack((np.full_like(z, x), np.zeros_like(z), z), axis=1)
    return points.astype(np.float32), (-outwards if inside else outwards).astype(np.float32)


def joined(*parts: Part, size_max: float = 1.0, tilt: float = 0.1, scatter: float = 0.001) -> list[list[int]]:
    """Which of the parts are joined, by number, seen with the noise of a depth camera, which tilts normals."""
    rng = np.random.default_rng(0)
    points, normals = (np.concatenate(stacked) for stacked in zip(*parts, strict=True))
    points = (points + rng.normal(0, scatter, points.shape)).astype(np.float32)
    normals = normals + rng.normal(0, tilt, normals.shape).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    owner = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part[0]) for part in parts])
    labels = join_vessels(owner[None], points[None], normals[None], UP, size_max, KINECT_V1)[0]
    return [np.unique(owner[labels == label]).tolist() for label in np.unique(labels)]


# A mug seen from the front and above: its far inside above the near rim, and its near outside.
INSIDE = arc(20, 160, HEIGHT - 0.03, HEIGHT, inside=True)
OUTSIDE = arc(190, 350, 0.0, HEIGHT, inside=False, radius=RADIUS + 0.004)


def test_the_inside_of_a_mug_belongs_to_its_outside() -> None:
    assert joined(INSIDE, OUTSIDE) == [[0, 1]]


def test_where_normals_are_poor_the_places_of_an_inside_tell_its_axis() -> None:
    assert joined(INSIDE, OUTSIDE, tilt=0.6) == [[0, 1]]
    flat = np.stack((np.linspace(-0.04, 0.04, 200), np.tile((0.001, -0.001), 100), np.linspace(0.07, 0.1, 200)), axis=1)
    wall = flat.astype(np.float32), np.tile(np.float32((0, -1, 0)), (200, 1))
    assert joined(wall, OUTSIDE, tilt=0.6) == [[0], [1]]
    assert joined(arc(20, 160, 0.07, HEIGHT, inside=False), OUTSIDE, tilt=0.6) == [[0], [1]]


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("a mug beside it", arc(190, 350, 0.0, HEIGHT, inside=False, x=2.2 * RADIUS)),
        ("a can on its rim", arc(190, 350, HEIGHT, HEIGHT + 0.06, inside=False, radius=0.03)),
        ("a can beneath it", arc(190, 350, -0.12, 0.0, inside=False, radius=0.03)),
    ],
)
def test_another_thing_does_not(name: str, other: Part) -> None:
    assert joined(INSIDE, other) == [[0], [1]], name


def bowl(start: float, end: float, low: float, high: float, inside: bool) -> Part:
    """Points and normals of a bowl's wall, 16 cm across at its rim of 6 cm, between two angles and two heights."""
    angle, z = (
        grid.ravel() for grid in np.meshgrid(np.deg2rad(np.arange(start, end, 5.0)), np.arange(low, high, 0.004))
    )
    a, c = 0.08, 0.068
    radius = a * np.sqrt(1 - ((0.06 - z) / c) ** 2)
    points = np.stack((radius * np.cos(angle), radius * np.sin(angle), z), axis=1)
    outwards = points * (1 / a**2, 1 / a**2, 0) + np.stack((0 * z, 0 * z, (z - 0.06) / c**2), axis=1)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return points.astype(np.float32), (-outwards if inside else outwards).astype(np.float32)


def test_the_inside_of_a_bowl_belongs_to_its_outside() -> None:
    """Its walls are at no one distance from the axis, and from afar its normals hardly aim at it."""
    assert joined(bowl(-10, 190, 0.012, 0.06, inside=True), bowl(200, 340, 0.0, 0.06, inside=False), tilt=0.6) == [
        [0, 1]
    ]


@pytest.mark.parametrize(("away", "groups"), [(1.0, [[0], [1]]), (2.0, [[0, 1]])])
def test_depth_may_scatter_as_much_as_it_does_there(away: float, groups: list[list[int]]) -> None:
    """Two metres away noise scatters a mug's walls by a fifth of its radius; one metre away what does is no mug."""
    far = np.float32((0, 0, away))
    inside, outside = ((points + far, normals) for points, normals in (INSIDE, OUTSIDE))
    assert joined(inside, outside, tilt=0.6, scatter=0.005) == groups


def test_the_outside_of_one_thing_holds_nothing() -> None:
    assert joined(arc(20, 160, 0, HEIGHT, inside=False), OUTSIDE) == [[0], [1]]


def test_thin_walls_seen_from_both_sides_are_a_vessel_too() -> None:
    """Their normals tell no side; the rest of the wall comes with the handle that hangs on it."""
    points, normals = arc(60, 330, 0, HEIGHT, inside=False)
    walls = points, np.where(np.arange(len(points))[:, None] % 2, normals, -normals)
    handle = (np.linspace((RADIUS, 0, 0.02), (RADIUS + 0.025, 0, HEIGHT - 0.015), 40)).astype(np.float32)
    rest_points, rest_normals = arc(-30, 60, 0, HEIGHT, inside=False)
    rest = np.concatenate((rest_points, handle)), np.concatenate((rest_normals, np.tile(rest_normals[:1], (40, 1))))
    assert joined(walls, rest) == [[0, 1]]
    half = arc(60, 200, 0, HEIGHT, inside=False)
    assert joined((half[0], walls[1][: len(half[0])]), rest) == [[0], [1]]


def test_a_flat_wall_is_not_hollow() -> None:
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(-0.05, 0.05, 0.004), np.arange(0, HEIGHT, 0.004)))
    wall = np.stack((x, np.full_like(x, 0.05), z), axis=1).astype(np.float32)
    assert joined((wall, np.tile(np.float32([0, -1, 0]), (len(wall), 1))), OUTSIDE) == [[0], [1]]


def test_a_hollow_wider_than_an_object_is_a_corner_of_the_room() -> None:
    room = arc(20, 160, 0, HEIGHT, inside=True, radius=0.6)
    assert joined(room, OUTSIDE) == [[0], [1]]
    assert joined(room, OUTSIDE, size_max=1.5) == [[0, 1]]


def test_nothing_is_joined_where_there_is_nothing() -> None:
    labels, nothing = np.full((2, 3), -1, np.int32), np.zeros((2, 3, 3), np.float32)
    np.testing.assert_array_equal(join_vessels(labels, nothing, nothing, UP, 1.0, KINECT_V1), labels)


def test_the_share_within_a_cylinder_is_that_of_its_points() -> None:
    distance = np.linalg.norm(INSIDE[0][:, :2] - (0.03, 0.01), axis=1)
    assert _share_near(INSIDE[0], np.array((0.03, 0.01)), 0.04) == pytest.approx(np.mean(distance < 0.04))


@pytest.mark.parametrize(("start", "end", "sides"), [(0.0, 360.0, 12), (10.0, 170.0, 6)])
@pytest.mark.parametrize("flare", [0.0, 0.3])
def test_a_ring_is_the_plain_least_squares_one(flare: float, start: float, end: float, sides: int) -> None:
    rng = np.random.default_rng(1)
    places = arc(start, end, 0, HEIGHT, inside=False)[0]
    places[:, :2] *= 1 + flare * places[:, 2:] / HEIGHT
    places = (places + rng.normal(0, 0.001, places.shape) + (2.0, 0, 0)).astype(np.float32)
    level, z = places[:, :2].astype(np.float64), places[:, 2].astype(np.float64)
    terms = np.column_stack((2 * level, z, np.ones(len(z))))
    a, b, slope, c = np.linalg.lstsq(terms, (level**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(c + a * a + b * b + slope * np.append(z, z.mean()))
    x, y, share, seen = _ring_of(places, 0.0)
    np.testing.assert_allclose((x, y), (a, b), atol=1e-6)
    off = np.abs(np.linalg.norm(level - (a, b), axis=1) - radius[:-1])
    assert share == pytest.approx(np.mean(off < 0.12 * radius[-1]))
    assert seen == sides
    assert _ring_of(places, 0.4 * RADIUS)[2] < share  # scattered by so much it may as well be flat


def test_what_lies_in_a_plane_is_no_ring() -> None:
    line = np.column_stack((np.arange(20), np.arange(20), np.zeros(20))).astype(np.float32)
    wall = np.column_stack((np.tile(np.arange(5), 4), np.zeros(20), np.repeat(np.arange(4), 5))).astype(np.float32)
    for flat in (line, line[:1], wall):
        assert _ring_of(flat, 0.0)[2] == 0
