"""Holes in depth, continued along colours."""

from itertools import pairwise

import numpy as np
import pytest
from scenes import camera

from spot3d.geometry.inverse_depth import fill_inverse_depth
from spot3d.proposals.edges import detect_edges
from spot3d.proposals.holes import fill_along_colour
from spot3d.proposals.settings import EdgeSettings

CONTRAST = np.float32(5)
FOCAL = 280.0


def filled(depth, colour):
    return fill_along_colour(depth, colour, FOCAL, CONTRAST)


def grey(shape):
    return np.full((*shape, 3), 128, np.uint8)


def is_shadow(depth, colour, y, left, right):
    """Of the pixels between two with depth: see `_find_open`."""
    near, far = (left, right) if depth[y, left] < depth[y, right] else (right, left)
    if right - left - 1 > FOCAL * 0.1 * (1 / depth[y, near] - 1 / depth[y, far]):
        return False
    row = colour[y, min(far, near + (1 if far > near else -1)) : max(far, near + (1 if far > near else -1)) + 1]
    return np.abs(np.diff(row.astype(int), axis=0)).max(initial=0) <= CONTRAST


def plainly_filled(depth, colour):
    """The same, pixel by pixel."""
    inverse = np.empty_like(depth)
    fill_inverse_depth(depth, inverse)
    is_open = depth == 0
    for y in range(depth.shape[0]):
        there = np.flatnonzero(depth[y])
        for left, right in pairwise(there):
            if is_shadow(depth, colour, y, left, right):
                is_open[y, left + 1 : right] = False
    holes = [(y, x) for half in (0, 1) for y, x in np.argwhere(is_open) if (y + x) % 2 == half]
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


@pytest.mark.parametrize(("background", "depth_beside"), [(120, 2.0), (128, 2.0)])
def test_a_shadow_takes_the_depth_of_what_is_behind(background, depth_beside):
    depth, colour = np.full((40, 60), depth_beside, np.float32), np.full((40, 60, 3), background, np.uint8)
    depth[:, 30:], colour[:, 30:] = 1.0, 128
    depth[:, 18:30] = 0
    np.testing.assert_allclose(filled(depth, colour)[:, 18:30], 1 / depth_beside, rtol=1e-6)


def test_what_is_wider_than_a_shadow_is_none():
    depth = np.full((40, 90), 2.0, np.float32)
    depth[:, 60:] = 1.0
    depth[10:30, 30:60] = 0  # parallax is 14 pixels
    inverse = filled(depth, grey(depth.shape))
    assert (np.diff(inverse[20, 30:60]) > 0).all()
