"""Holes in depth, continued along colours."""

import numpy as np
import pytest
from scenes import camera

from spot3d.geometry.inverse_depth import fill_inverse_depth
from spot3d.proposals.edges import detect_edges
from spot3d.proposals.holes import fill_along_colour
from spot3d.proposals.settings import EdgeSettings

CONTRAST = np.float32(5)


def filled(depth, colour):
    return fill_along_colour(depth, colour, CONTRAST)


def grey(shape):
    return np.full((*shape, 3), 128, np.uint8)


def plainly_filled(depth, colour):
    """The same, pixel by pixel."""
    inverse = np.empty_like(depth)
    fill_inverse_depth(depth, inverse)
    holes = [(y, x) for half in (0, 1) for y, x in np.argwhere(depth == 0) if (y + x) % 2 == half]
    for _ in range(20):
        for y, x in holes:
            weights, values = [], []
            for v, u in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if 0 <= v < depth.shape[0] and 0 <= u < depth.shape[1]:
                    apart = np.abs(colour[y, x].astype(float) - colour[v, u]).max()
                    weights.append(1e-3 + np.exp(-((apart / CONTRAST) ** 2)))
                    values.append(inverse[v, u])
            inverse[y, x] += 1.75 * (np.average(values, weights=weights) - inverse[y, x])
    return inverse


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_equals_the_plain_transcription(seed):
    rng = np.random.default_rng(seed)
    shape = (23, 31)
    depth = np.where(rng.random((1, 31)) < 0.5, 0.8, 1.6).astype(np.float32) + np.zeros(shape, np.float32)
    depth[rng.random(shape) < 0.4] = 0
    depth[5:15, 8:20] = 0
    colour = (128 + 4 * rng.integers(0, 3, (*shape, 1)) * rng.integers(0, 2, 3)).astype(np.uint8)
    np.testing.assert_allclose(filled(depth, colour), plainly_filled(depth, colour), rtol=1e-4)


def test_measured_depth_stays():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 3, (20, 30)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.5] = 0
    there = depth > 0
    np.testing.assert_array_equal(filled(depth, grey(depth.shape))[there], 1 / depth[there])


def test_a_hole_in_a_plane_that_turns_away_is_filled_with_the_plane():
    plane = (0.5 + 0.005 * np.arange(60) + np.zeros((40, 1))).astype(np.float32)  # inverse depth
    depth = 1 / plane
    depth[10:30, 15:40] = 0
    rows = np.empty_like(depth)
    fill_inverse_depth(depth, rows)
    off, before = np.abs(filled(depth, grey(depth.shape)) - plane).max(), np.abs(rows - plane).max()
    assert before > 0.1
    assert off < before / 4


def test_the_side_of_a_torn_pole_goes_on_in_its_colour():
    depth, colour = np.full((240, 320), 2.0, np.float32), np.full((240, 320, 3), 120, np.uint8)
    depth[:, 150:170], colour[:, 150:170] = 1.0, 150
    depth[100:120, 160:200] = 0  # the pole's right half, and what is beside it
    edges = detect_edges(colour, depth, camera().fx, EdgeSettings()).magnitude
    for y in range(98, 122):
        crossed = np.flatnonzero(edges[y, 140:220]) + 140
        np.testing.assert_allclose(crossed, [150, 169], atol=1, err_msg=f"row {y}")
        assert edges[y, crossed].min() > 0.5, f"row {y}"  # more than colour alone gives


@pytest.mark.parametrize("width", [5, 12, 20])
def test_a_shadow_of_the_colour_behind_takes_the_depth_behind(width):
    depth, colour = np.full((40, 60), 2.0, np.float32), np.full((40, 60, 3), 120, np.uint8)
    depth[:, 30:], colour[:, 30:] = 1.0, 150
    depth[:, 30 - width : 30] = 0
    np.testing.assert_allclose(filled(depth, colour)[:, 30 - width : 30], 1 / 2.0, rtol=0.015)
