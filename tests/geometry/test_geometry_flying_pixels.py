"""Pixels that hang between two surfaces go to one of them or are left out; surfaces, edges and noise stay."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.depth_noise import GRAZING_COS, KINECT_V1
from spot3d.geometry.downsampling import to_lattice
from spot3d.geometry.flying_pixels import without_flying

CAMERA = Intrinsics(525.0, 525.0, 319.5, 239.5, 640, 480)
INSIDE = np.s_[200:300, 250:350]


def step(near: float = 1.0, far: float = 1.4) -> NDArray[np.float32]:
    """A square before a wall."""
    depth = np.full(CAMERA.shape, far, np.float32)
    depth[INSIDE] = near
    return depth


def clear(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    return without_flying(depth, CAMERA.fx, GRAZING_COS)


@pytest.mark.parametrize("width", [3, 5])
def test_where_edges_are_mixed_pixels_go_to_the_surface_that_is_nearer(width: int) -> None:
    mixed = cv2.blur(step(), (width, width))
    flies = (mixed > 1.001) & (mixed < 1.399)
    moved = clear(mixed)
    assert flies.sum() > 300
    # But for the corners, a mean of both surfaces is nearer to the one on whose side it is.
    assert (np.abs(moved - step())[flies] < 0.01).mean() > 0.98
    np.testing.assert_array_equal(moved[~flies], mixed[~flies])


def test_a_veil_too_wide_to_say_where_the_edge_is_is_left_out() -> None:
    mixed = cv2.blur(step(), (15, 15))
    flies = (mixed > 1.005) & (mixed < 1.395)
    left = clear(mixed)
    assert flies.sum() > 3000
    # What is left lies next to a surface, and is hardly off it.
    assert ((left > 1.03) & (left < 1.37)).sum() < 0.05 * flies.sum()


def test_where_edges_are_sharp_the_narrow_side_of_a_thing_stays() -> None:
    """Four pixels of a side that is seen at 75 degrees, along one edge of four: this camera can see it."""
    depth = step()
    depth[200:300, 350:354] = 1 + np.arange(1, 5) * np.tan(np.radians(75)) / CAMERA.fx
    np.testing.assert_array_equal(clear(depth), depth)


def test_where_most_edges_are_sharp_what_floats_beside_another_one_is_left_out() -> None:
    depth, side = step(), np.s_[210:290, 345:355]
    depth[side] = cv2.blur(depth, (3, 3))[side]
    flies = (depth > 1.001) & (depth < 1.399)
    assert flies.sum() == 160
    np.testing.assert_array_equal(clear(depth), np.where(flies, 0, depth))


def test_edges_corners_and_holes_stay() -> None:
    depth = step()
    np.testing.assert_array_equal(clear(depth), depth)
    depth[240:260, 240:260] = 0
    np.testing.assert_array_equal(clear(depth), depth)


@pytest.mark.parametrize("degrees", [0, 45, 75])
def test_a_slanting_noisy_surface_stays(degrees: float) -> None:
    """A floor that is seen ever more along itself, up to 75 degrees."""
    normal = np.array((0, -np.sin(np.radians(degrees)), -np.cos(np.radians(degrees))))
    rays = back_project(np.ones(CAMERA.shape, np.float32), CAMERA).astype(np.float64)
    facing = -(rays @ normal) / np.linalg.norm(rays, axis=2)
    depth = np.where(facing > np.cos(np.radians(75)), 1.0 / np.maximum(-(rays @ normal), 1e-3), 0)
    depth = np.where(depth < 2.5, depth, 0)
    sigma = KINECT_V1.sigma(depth)
    noisy = np.where(depth > 0, depth + np.random.default_rng(1).normal(size=depth.shape) * sigma, 0).astype(np.float32)
    assert (depth > 0).mean() > 0.05
    assert ((clear(noisy) == 0) & (noisy > 0)).sum() < 1e-3 * (noisy > 0).sum()


def test_a_frame_that_becomes_smaller_has_no_veils() -> None:
    mixed, colour, heat = (
        cv2.blur(step(), (3, 3)),
        np.zeros((*CAMERA.shape, 3), np.uint8),
        np.zeros(CAMERA.shape, np.uint8),
    )
    small = to_lattice(colour, mixed, heat, CAMERA, 320).depth
    between = (small > 1.05) & (small < 1.35)
    kept = to_lattice(colour, mixed, heat, CAMERA, 320, grazing_cos=0).depth
    assert not between.any()
    assert ((kept > 1.05) & (kept < 1.35)).sum() > 100
