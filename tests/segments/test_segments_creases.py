"""Regions end at concave creases and at steps of depth, not at convex edges."""

import numpy as np
import pytest
from fusion_room import ROOM, Cuboid, look_at, standing, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.geometry.normals import surface_normals
from spot3d.segments.creases import split_at_creases
from spot3d.segments.settings import SegmentsSettings

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
CREASE, REGION = SegmentsSettings().crease, SegmentsSettings().region
LEAST = int(REGION * CAMERA.fx * CAMERA.fy)
POSE = look_at((0.3, -0.8, 0.6), (0, 0, 0.05))
RED, BLUE = (200, 40, 40), (50, 60, 200)
SIZE = (0.14, 0.1, 0.12)


def regions_of(
    *things: Cuboid, scale: float = 1.0, noise: bool = False, pose: NDArray[np.float64] = POSE
) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Regions of the things' pixels, and the view's colours. scale: of all lengths."""
    seen = view(pose, ROOM + things, np.random.default_rng(0) if noise else None, CAMERA)
    depth = (scale * seen.depth).astype(np.float32)
    mask = (seen.colour[..., None, :] == [thing.colour for thing in things]).all(-1).any(-1)
    points = back_project(depth, CAMERA)
    labels = split_at_creases(points, surface_normals(depth, CAMERA), mask, seen.colour, CAMERA.fx, CREASE, LEAST)
    assert ((labels >= 0) == mask).all(), "every pixel has a region"
    return labels, seen.colour


def large(labels: NDArray[np.int32]) -> list[int]:
    """The regions that are more than a few pixels of a rim."""
    return np.flatnonzero(np.bincount(labels[labels >= 0]) >= LEAST).tolist()


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_the_edges_of_a_box_do_not_split_it(yaw: float, noise: bool) -> None:
    labels, _ = regions_of(standing(0, 0, SIZE, yaw), noise=noise)
    assert len(large(labels)) == 1
    assert (labels[labels >= 0] == large(labels)[0]).mean() > 0.97


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("a lower one in front of it", standing(-0.05, -0.1, (0.2, 0.1, 0.05), colour=BLUE)),
        ("a lower one beside it", standing(0.14, -0.04, (0.14, 0.1, 0.06), colour=BLUE)),
        ("a smaller one upon it", Cuboid((0, 0, 0.15), (0.07, 0.05, 0.06), colour=BLUE)),
    ],
)
def test_a_box_that_touches_another_is_not_the_same(name: str, other: Cuboid, noise: bool) -> None:
    labels, colour = regions_of(standing(0, 0, SIZE, colour=RED), other, noise=noise)
    found = large(labels)
    assert len(found) == 2, name
    for thing in (RED, BLUE):
        own = np.bincount(labels[(colour == thing).all(-1) & (labels >= 0)], minlength=max(found) + 1)
        assert own.max() > 0.9 * own.sum(), f"{name}: the seam is where they touch"


def test_a_small_box_upon_another_is_not_the_same_from_afar() -> None:
    book = standing(0, 0, (0.16, 0.22, 0.06), colour=RED)
    cube = Cuboid((0, 0, 0.0875), (0.055, 0.055, 0.055), colour=BLUE)
    labels, colour = regions_of(book, cube, pose=look_at((0.7, -1.6, 1.0), (0, 0, 0.05)))
    shown = (colour == BLUE).all(-1)
    assert shown.sum() < LEAST, "from so far it shows fewer pixels than other regions need"
    of_cube = labels == np.bincount(labels[shown]).argmax()
    assert (of_cube & shown).sum() > 0.7 * (of_cube | shown).sum()


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("away", [1.0, 1.4])
def test_a_convex_edge_that_ends_on_a_crease_leaves_no_gap(away: float, noise: bool) -> None:
    """An upright edge of the upper box faces the camera, and its lower end is not hollow."""
    lower, upper = standing(0, 0, (0.28, 0.18, 0.11), 0.7, RED), Cuboid((0, 0, 0.15), (0.14, 0.09, 0.08), colour=BLUE)
    pose = look_at((0.6 * away, -0.8 * away, 0.6 * away), (0, 0, 0.05))
    assert len(large(regions_of(lower, upper, noise=noise, pose=pose)[0])) == 2


def test_a_step_of_depth_parts_what_no_crease_parts() -> None:
    far = standing(0.05, 0.3, (0.3, 0.05, 0.3), colour=BLUE)
    assert len(large(regions_of(standing(0, 0, SIZE, colour=RED), far)[0])) == 2


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_the_same_picture_of_a_larger_scene_has_the_same_regions(scale: float) -> None:
    things = standing(0, 0, SIZE, 0.3, RED), standing(0, -0.12, (0.14, 0.1, 0.05), 0.3, BLUE)
    np.testing.assert_array_equal(regions_of(*things, scale=scale)[0], regions_of(*things)[0])


@pytest.mark.parametrize("share", [0.8, 1.0, 1.6])
def test_from_near_and_from_far_there_are_as_many(share: float) -> None:
    pose = look_at(share * POSE[:3, 3])
    things = standing(0, 0, SIZE, colour=RED), standing(-0.05, -0.1, (0.2, 0.1, 0.05), colour=BLUE)
    assert len(large(regions_of(*things, pose=pose)[0])) == 2


GREY, SHADED, GREEN = (120, 120, 120), (95, 95, 95), (90, 140, 90)


@pytest.mark.parametrize(
    ("degrees", "left", "right", "count"),
    [
        (20, GREY, GREY, 1),
        (20, GREY, SHADED, 1),
        (20, GREY, GREEN, 2),
        (20, GREY, (20, 20, 20), 2),
        (60, GREY, GREY, 2),
        (3, GREY, GREEN, 1),
    ],
)
def test_what_is_of_one_colour_is_split_at_sharp_creases_alone(
    degrees: float, left: tuple[int, int, int], right: tuple[int, int, int], count: int
) -> None:
    """Two surfaces that lean towards the camera by so much on either side of a seam."""
    across = (np.arange(320) - CAMERA.cx) / CAMERA.fx
    depth = np.tile(1 / (1 + np.tan(np.deg2rad(degrees)) * np.abs(across)), (240, 1)).astype(np.float32)
    colour = np.where((across < 0)[None, :, None], np.array(left), np.array(right)) + np.zeros((240, 1, 1))
    mask = np.ones(depth.shape, np.bool_)
    points, normals = back_project(depth, CAMERA), surface_normals(depth, CAMERA)
    labels = split_at_creases(points, normals, mask, colour.astype(np.uint8), CAMERA.fx, CREASE, LEAST)
    assert len(large(labels)) == count
    assert len(large(split_at_creases(points, normals, mask, None, CAMERA.fx, CREASE, LEAST))) == 1 + (degrees > 10)


@pytest.mark.parametrize(("degrees", "there", "count"), [(18, 18, 2), (18, 11, 2), (11, 11, 1), (11, 8, 1)])
def test_a_crease_parts_as_a_whole(degrees: float, there: float, count: int) -> None:
    """Two surfaces that lean towards each other by so much, and in the middle of their seam by less: from 13 degrees on
    a pixel is a crease's. What is fainter all along is none."""
    across, v = (np.arange(320) - CAMERA.cx) / CAMERA.fx, np.arange(240)[:, None]
    lean = np.deg2rad(degrees - (degrees - there) * np.exp(-(((v - 120) / 25) ** 2)))
    depth = (1 / (1 + np.tan(lean) * np.abs(across))).astype(np.float32)
    points, normals, mask = back_project(depth, CAMERA), surface_normals(depth, CAMERA), np.ones(depth.shape, np.bool_)
    assert len(large(split_at_creases(points, normals, mask, None, CAMERA.fx, CREASE, LEAST))) == count


def test_what_lies_apart_is_not_joined_whatever_its_colour() -> None:
    near, far = standing(0, 0, SIZE, colour=RED), standing(0.05, 0.3, (0.3, 0.05, 0.3), colour=RED)
    assert len(large(regions_of(near, far)[0])) == 2


def test_of_no_pixels_there_is_no_region() -> None:
    points, none = np.zeros((12, 16, 3), np.float32), np.zeros((12, 16), np.bool_)
    labels = split_at_creases(points, points, none, None, 300.0, CREASE, LEAST)
    assert (labels == -1).all()


def test_what_is_near_no_region_is_one_of_its_own() -> None:
    """Patches too small to be regions by themselves, far apart."""
    depth = np.ones((24, 32), np.float32)
    mask = np.zeros(depth.shape, np.bool_)
    mask[2:5, 2:5] = mask[18:21, 25:28] = True
    camera = Intrinsics(300.0, 300.0, 15.5, 11.5, 32, 24)
    points, normals = back_project(depth, camera), surface_normals(depth, camera)
    labels = split_at_creases(points, normals, mask, None, 300.0, CREASE, LEAST)
    assert sorted(np.unique(labels[2:5, 2:5]).tolist() + np.unique(labels[18:21, 25:28]).tolist()) == [0, 1]


def test_regions_are_numbered_without_gaps() -> None:
    labels, _ = regions_of(standing(0, 0, SIZE, colour=RED), standing(0.3, 0, SIZE, colour=BLUE), noise=True)
    assert np.unique(labels).tolist() == list(range(-1, labels.max() + 1))


@pytest.mark.parametrize("height", [0.25, 0.3, 0.35])
def test_a_surface_that_is_seen_along_does_not_fall_apart_into_rows(height: float) -> None:
    """The top of a box, from a camera that is little higher."""
    labels, _ = regions_of(standing(0, 0, (0.2, 0.15, 0.12)), noise=True, pose=look_at((0, -0.9, height), (0, 0, 0.1)))
    assert len(np.unique(labels[labels >= 0])) == 1
