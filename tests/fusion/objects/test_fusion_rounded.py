"""What is round is as deep as it is wide, though it was seen from one side alone."""

from collections.abc import Callable

import numpy as np
import pytest
from fusion_room import rotation_z
from numpy.typing import NDArray

from spot3d.fusion.objects.found import ObjectViews, box_of
from spot3d.fusion.objects.outline import OUTERMOST
from spot3d.fusion.objects.views import SAMPLE

UP = np.array([0.0, 0.0, 1.0])
RADIUS, HEIGHT, NOISE = 0.04, 0.12, 0.0015
CENTRE = np.array([0.3, -0.2, 0.7])

Surface = Callable[[np.random.Generator], NDArray[np.float64]]
"""Makes SAMPLE points about the origin that a camera sees which looks along y, from less than 0."""


def can(rng: np.random.Generator) -> NDArray[np.float64]:
    angle, height = rng.uniform(-1.3, 1.3, SAMPLE), rng.uniform(-0.5, 0.5, SAMPLE) * HEIGHT
    return np.column_stack((RADIUS * np.sin(angle), -RADIUS * np.cos(angle), height))


def ball(rng: np.random.Generator) -> NDArray[np.float64]:
    # Towards a camera that looks down by 35 degrees.
    towards = rng.normal(size=(20 * SAMPLE, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return RADIUS * towards[towards @ (0, -0.82, 0.57) > 0.2][:SAMPLE]


def pot(rng: np.random.Generator) -> NDArray[np.float64]:
    wall = can(rng)
    return wall * (1 + 2 * wall[:, 2:] * (1, 1, 0))  # wider above


def mug(rng: np.random.Generator) -> NDArray[np.float64]:
    wall, handle = can(rng), np.arange(SAMPLE) % 9 == 0
    wall[handle, :2] = rng.uniform((RADIUS, -0.004), (1.7 * RADIUS, 0.004), (np.count_nonzero(handle), 2))
    return wall


def cube(rng: np.random.Generator, size: float = 0.07) -> NDArray[np.float64]:
    """Its top, and two faces across its corner."""
    points, face = rng.uniform(0, size, (SAMPLE, 3)), np.arange(SAMPLE) % 3
    points[face == 0, 0] = points[face == 1, 1] = 0
    points[face == 2, 2] = size
    return points @ rotation_z(np.pi / 4).T - (0, RADIUS, size / 2)


def die(rng: np.random.Generator) -> NDArray[np.float64]:
    return cube(rng, 0.04)


def front(rng: np.random.Generator) -> NDArray[np.float64]:
    return rng.uniform((-0.1, 0.0, -0.1), (0.1, 0.003, 0.1), (SAMPLE, 3))


def mouse(rng: np.random.Generator) -> NDArray[np.float64]:
    """The upper half of an egg that lies across, from 20 degrees above."""
    axes = np.array((0.055, 0.032, 0.035))
    towards = rng.normal(size=(40 * SAMPLE, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    normals = towards / axes
    facing = normals @ (0, -0.94, 0.34) > 0.15 * np.linalg.norm(normals, axis=1)
    return (towards * axes)[facing & (towards[:, 2] > 0)][:SAMPLE]


def seen(surfaces: list[Surface], noise: float = NOISE, wide: float = 40.0) -> ObjectViews:
    """One segment in each of as many views, from one side, so many degrees wide."""
    rng, yaws = np.random.default_rng(1), np.deg2rad(np.linspace(-wide / 2, wide / 2, len(surfaces)))
    # A thing that is round looks alike from each view; what is not is turned with it, too, which changes nothing here.
    places = [surface(rng) @ rotation_z(yaw).T + CENTRE for surface, yaw in zip(surfaces, yaws, strict=True)]
    noisy = np.array(places) + rng.normal(0, noise, (len(places), SAMPLE, 3))
    eyes = np.array([rotation_z(yaw) @ (0.0, -0.8, 0.5) for yaw in yaws]) + CENTRE
    outline = np.full((len(places), OUTERMOST, 3), np.nan, np.float32)
    nothing = np.zeros((len(places), 4))
    return ObjectViews(
        noisy.astype(np.float32), outline, nothing[:, :3].astype(np.float32), nothing, np.arange(len(eyes)), eyes
    )


@pytest.mark.parametrize("count", [3, 12, 50])
@pytest.mark.parametrize("surface", [can, ball, pot])
def test_what_is_round_is_as_deep_as_it_is_wide(surface: Surface, count: int) -> None:
    views = seen([surface] * count)
    wide = 2 * RADIUS * (1 + HEIGHT * (surface is pot))
    with_back, without = box_of(views, UP, 0.005), box_of(views, UP, 0.005, rounded=False)
    assert with_back.size[:2] == pytest.approx((wide, wide), abs=0.006)
    assert with_back.centre[:2] == pytest.approx(CENTRE[:2], abs=0.004)
    assert without.volume < 0.85 * with_back.volume
    assert with_back.size[2] == without.size[2]


def test_a_handle_is_outside_of_what_is_round() -> None:
    box = box_of(seen([mug] * 8), UP, 0.005)
    assert box.size[:2].min() == pytest.approx(2 * RADIUS, abs=0.012)
    assert box.size[:2].max() == pytest.approx(2.7 * RADIUS, abs=0.012)


@pytest.mark.parametrize("surface", [cube, die, front, mouse])
def test_what_is_not_round_has_the_box_of_what_was_seen(surface: Surface) -> None:
    views = seen([surface] * 8)
    with_back, without = box_of(views, UP, 0.005), box_of(views, UP, 0.005, rounded=False)
    assert np.array_equal(with_back.size, without.size)
    assert np.array_equal(with_back.centre, without.centre)


@pytest.mark.parametrize("count", [1, 2])
def test_a_view_or_two_tell_nothing(count: int) -> None:
    views = seen([can] * count)
    assert np.array_equal(box_of(views, UP, 0.005).size, box_of(views, UP, 0.005, rounded=False).size)


def test_a_side_that_was_seen_is_where_it_was_seen() -> None:
    around = seen([can] * 12, wide=330.0)
    with_back, without = box_of(around, UP, 0.005), box_of(around, UP, 0.005, rounded=False)
    assert np.array_equal(with_back.size, without.size)
    half = seen([can] * 12, wide=170.0)  # from the front and both sides
    with_back, without = box_of(half, UP, 0.005), box_of(half, UP, 0.005, rounded=False)
    assert with_back.size[:2] == pytest.approx((2 * RADIUS, 2 * RADIUS), abs=0.006)
    assert np.count_nonzero(with_back.size != without.size) <= 1


@pytest.mark.parametrize(("round_ones", "deep"), [(6, True), (4, False)])
def test_most_views_must_have_it_round(round_ones: int, deep: bool) -> None:
    views = seen([can] * round_ones + [die] * (9 - round_ones))
    with_back, without = box_of(views, UP, 0.005), box_of(views, UP, 0.005, rounded=False)
    assert (with_back.volume > without.volume) is deep


def test_noise_hides_that_something_is_round() -> None:
    views = seen([can] * 8, noise=0.01)
    assert np.array_equal(box_of(views, UP, 0.005).size, box_of(views, UP, 0.005, rounded=False).size)


@pytest.mark.parametrize("places", [np.zeros((3, SAMPLE, 3)), np.full((2, SAMPLE, 3), (0.1, 0.2, 0.3))])
def test_a_single_point_is_not_round(places: NDArray[np.float64]) -> None:
    views = seen([can] * len(places))
    lone = ObjectViews(places.astype(np.float32), views.outline, views.blur, views.support, views.frame, views.eyes)
    assert box_of(lone, UP, 0.005).size[:2].max() < 0.002
