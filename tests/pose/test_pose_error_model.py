"""How wrong given poses and odometry are, told apart on ways of a camera whose errors are known."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.pose.error_model import ErrorModel
from spot3d.pose.motion import moved
from spot3d.trajectory import rotation_from_vector

SIGMA = np.repeat((0.02, 0.014), 3)
STEP_S, SECONDS, ALIKE_S = 0.1, 25.0, 1 / 3
# A registration whose surface is worth one point: half of the stated uncertainty in each direction.
SPREAD, KNOWN = 0.25 * np.eye(6), 4 * np.eye(6)


def ways(
    noise: float, drift: float, scale: float = 1.0, seed: int = 0
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Poses (4, 4) of a camera that walks around a table, ten a second: by odometry, and as given.

    noise: of the given poses, in stated standard deviations; drift: of odometry, variance a second in units of that of
    a registration; scale: by how much longer odometry's way is.
    """
    rng, keep, error = np.random.default_rng(seed), np.exp(-STEP_S / ALIKE_S), np.zeros(6)
    odometry, given, drifted = [], [], np.zeros(6)
    error = noise * rng.normal(size=6)
    for k in range(int(SECONDS / STEP_S)):
        angle = 0.4 * k * STEP_S
        true = np.eye(4)
        true[:3, :3] = rotation_from_vector(np.array((0.0, 0.0, angle)))
        true[:3, 3] = 1.5 * np.cos(angle), 1.5 * np.sin(angle), 1.0 + 0.3 * np.sin(3 * angle)
        error = keep * error + np.sqrt(1 - keep**2) * noise * rng.normal(size=6)
        drifted += np.sqrt(drift * STEP_S * SPREAD[0, 0]) * rng.normal(size=6)
        given.append(moved(true, SIGMA * error))
        path = true.copy()
        path[:3, 3] = true[:3, 3] * scale
        # A drift that turns also turns the way from there on, as no table is wide enough to tell: it is left out.
        odometry.append(moved(path, SIGMA * drifted * (1, 1, 1, 0, 0, 0)))
    return odometry, given


def learnt(noise: float, drift: float, scale: float = 1.0, seed: int = 0) -> ErrorModel:
    model = ErrorModel(SIGMA)
    for k, (odometry, given) in enumerate(zip(*ways(noise, drift, scale, seed), strict=True)):
        model.learn(STEP_S * k, odometry, given, KNOWN)
    return model


@pytest.mark.parametrize("noise", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_the_given_poses_is_measured(noise: float, seed: int) -> None:
    assert learnt(noise, 0.001, seed=seed).given ** 0.5 == pytest.approx(noise, rel=0.25)


@pytest.mark.parametrize("seed", range(3))
def test_odometry_that_drifts_is_told_from_given_poses_that_are_noisy(seed: int) -> None:
    steady, drifting = (learnt(0.5, drift, seed=seed) for drift in (0.001, 2.0))
    assert steady.drift < 0.05
    assert drifting.drift > 0.3
    assert drifting.given**0.5 == pytest.approx(0.5, rel=0.5)


def test_exact_poses_are_exact() -> None:
    assert learnt(0.0, 1e-6).given < 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_depth_of_another_scale_is_neither_noise_nor_drift(seed: int) -> None:
    model = learnt(0.5, 0.001, 1.03, seed)
    assert model.given**0.5 == pytest.approx(0.5, rel=0.25)
    assert model.drift < 0.05


def test_depth_that_is_corrected_has_the_right_scale_from_there_on() -> None:
    model = learnt(0.25, 0.001, 1.03)
    scales = [model._mean[0, 6] * SIGMA[0]]
    model.rescaled(1 / 1.03)
    scales.append(model._mean[0, 6] * SIGMA[0])
    np.testing.assert_allclose(scales, (-np.log(1.03), 0), atol=0.005)


def test_a_jump_is_no_noise() -> None:
    """As where motion capture takes another marker: half a metre, all at once, and both begin anew."""
    model = ErrorModel(SIGMA)
    for k, (odometry, given) in enumerate(zip(*ways(0.5, 0.001), strict=True)):
        if k == 125:
            model.interrupt()
        elsewhere = given.copy()
        elsewhere[0, 3] += 0.5 * (k >= 125)
        model.learn(STEP_S * k, odometry, elsewhere, KNOWN)
    assert model.given**0.5 == pytest.approx(0.5, rel=0.25)
    assert model.drift < 0.05


def test_one_pose_that_is_far_off_counts_little() -> None:
    model = ErrorModel(SIGMA)
    for k, (odometry, given) in enumerate(zip(*ways(0.5, 0.001), strict=True)):
        pose = given.copy()
        pose[0, 3] += 0.5 * (k == 120)
        model.learn(STEP_S * k, odometry, pose, KNOWN)
    assert model.given**0.5 == pytest.approx(0.5, rel=0.5)


@pytest.mark.parametrize("pause_s", [300.0, 600.0])
def test_after_a_pause_given_poses_are_as_wrong_as_before(pause_s: float) -> None:
    known, ratios = 1e3 * np.eye(6), []
    for seed in range(5):
        model, rng, place = ErrorModel(SIGMA), np.random.default_rng(seed), np.eye(4)
        given = []
        for second in [*range(60), *(pause_s + np.arange(60, 64))]:
            place[:3, 3] += 0.1 * rng.normal(size=3)
            told = place.copy()
            told[:3, 3] += 0.01 * rng.normal(size=3)
            model.learn(float(second), place.copy(), told, known)
            given.append(model.given)
        ratios.append(given[-1] / given[59])
    assert np.mean(ratios) > 0.6
