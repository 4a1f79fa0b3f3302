"""What is corrected of depth."""

import numpy as np
import pytest

from spot3d.calibration import NOMINAL, Calibration, bend_at, bend_of_image

GRID = np.random.default_rng(0).uniform(-0.02, 0.02, (4, 6))
BENT = Calibration(bend=tuple(tuple(row) for row in GRID.tolist()))


def test_what_bends_depth_is_told_from_corner_to_corner() -> None:
    image = bend_of_image(GRID, (240, 320))
    assert image[0, 0] == pytest.approx(GRID[0, 0], abs=1e-3)
    assert image[-1, -1] == pytest.approx(GRID[-1, -1], abs=1e-3)
    # A fifth of the way across, a third of it down is the next of the lattice's places.
    assert image[80, 64] == pytest.approx(GRID[1, 1], abs=1e-3)
    half = 0.5 * (GRID[1, 1] + GRID[1, 2])
    assert image[80, 96] == pytest.approx(half, abs=1e-3)


def test_a_place_is_bent_as_its_pixel_is() -> None:
    v, u = np.indices((48, 64))
    np.testing.assert_allclose(bend_at(GRID, (u + 0.5) / 64, (v + 0.5) / 48), bend_of_image(GRID, (48, 64)))
    assert bend_at(GRID, np.array(-3.0), np.array(7.0)) == GRID[-1, 0]


def test_depth_is_straightened_in_its_own_unit_and_then_of_the_right_length() -> None:
    depth = np.full((240, 320), 2.0, np.float32)
    depth[:, :9] = 0.0
    straight = BENT.straightened(depth)
    assert straight.dtype == np.float32
    np.testing.assert_allclose(straight, depth * np.exp(bend_of_image(GRID, depth.shape)), rtol=1e-6)
    known = Calibration(0.97, bend=BENT.bend)
    np.testing.assert_allclose(known.metres(depth), 0.97 * straight, rtol=1e-6)
    assert NOMINAL.metres(depth) is depth


def test_half_the_size_is_bent_alike() -> None:
    whole, half = (bend_of_image(GRID, (48 * k, 64 * k)) for k in (2, 1))
    np.testing.assert_allclose(whole.reshape(48, 2, 64, 2).mean(axis=(1, 3)), half, atol=1e-3)


def test_what_is_to_be_straightened_is_what_is_not_yet() -> None:
    assert BENT.straighter(BENT) is None
    assert NOMINAL.straighter(NOMINAL) is None
    for before, now, change in ((NOMINAL, BENT, GRID), (BENT, NOMINAL, -GRID)):
        np.testing.assert_array_equal(before.straighter(now), change)
