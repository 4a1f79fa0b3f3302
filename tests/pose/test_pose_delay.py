"""Given poses that are older or newer than their images."""

import numpy as np
import pytest
from numpy.typing import NDArray
from test_pose_correction import CAMERA, shaken

from spot3d.pose.delay import PoseDelay, told
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.motion import rotation_from_vector
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.source.scene.scene import Scene

RATE, SECONDS, LATE = 30, 9, 3
SIGMA = np.repeat((0.02, 0.014), 3)


def followed(
    late: int, metres: float = 0.0, sigma: float = 0.03, jump: float = 0.0
) -> tuple[list[PoseEstimate], NDArray[np.float64], NDArray[np.float64]]:
    """The built-in scene, every third frame, with poses late by so many of its frames and shaken by so many metres.

    jump: metres by which the given poses are elsewhere from the last third on.
    Also returned: the true poses, and those that were given.
    """
    scene = Scene(0, frames=RATE * SECONDS, intrinsics=CAMERA)
    frames = range(LATE, RATE * SECONDS - LATE, 3)
    true, given = (np.array([scene.true_pose(frame - lag) for frame in frames]) for lag in (0, late))
    given = shaken(given, metres, 40 * metres) if metres else given
    given[2 * len(given) // 3 :, 0, 3] += jump
    tracker = make_tracker(PoseSettings(provider="given", given_delay_sigma=sigma))
    estimates = [
        tracker.track(int(1e9 * frame / RATE), scene[frame].depth_metres(), CAMERA, pose)
        for frame, pose in zip(frames, given, strict=True)
    ]
    assert {estimate.status for estimate in estimates} == {"ok"}
    return estimates, true, given


@pytest.mark.parametrize("late", [-LATE, LATE])
def test_poses_that_are_late_or_early_are_put_in_time(late: int) -> None:
    estimates, true, given = followed(late)
    assert estimates[0].delay_s == 0
    assert estimates[-1].delay_s == pytest.approx(late / RATE, rel=0.4)
    corrected = np.array([estimate.T_world_camera for estimate in estimates])
    off, before = (
        np.linalg.norm(poses[-20:, :3, 3] - true[-20:, :3, 3], axis=1).mean() for poses in (corrected, given)
    )
    assert off < 0.5 * before


@pytest.mark.parametrize("metres", [0.0, 0.01, 0.02])
def test_poses_that_are_in_time_stay_so(metres: float) -> None:
    estimates, _, _ = followed(0, metres)
    assert max(abs(estimate.delay_s) for estimate in estimates) <= 0.003


@pytest.mark.parametrize("jump", [0.2, 1.0])
def test_poses_that_jump_are_as_late_as_before(jump: float) -> None:
    estimates, _, given = followed(LATE, jump=jump)
    after = 2 * len(given) // 3
    known_s = estimates[after - 1].delay_s
    assert known_s > 0.02
    assert known_s - 0.005 < estimates[-1].delay_s < 1.4 * LATE / RATE
    corrected = np.array([estimate.T_world_camera for estimate in estimates])
    assert np.linalg.norm(corrected[after:, :3, 3] - given[after:, :3, 3], axis=1).max() < 0.15


def test_poses_are_taken_as_they_are_where_they_are_told_to_be_in_time() -> None:
    estimates, _, _ = followed(LATE, sigma=0.0)
    assert {estimate.delay_s for estimate in estimates} == {0.0}


def swinging(delay: PoseDelay, lag_s: float, step_s: float, noise: float = 0.0, count: int = 200) -> None:
    """Give a camera that swings from side to side by poses of `lag_s` ago, registered to where it is."""
    rng = np.random.default_rng(0)
    for index in range(count):
        time_s = step_s * index
        place = np.eye(4)
        place[:3, :3] = rotation_from_vector(np.array([0.0, 0.2 * np.sin(2 * (time_s - lag_s)), 0.0]))
        place[0, 3] = 0.3 * np.sin(3 * (time_s - lag_s))
        compensated = delay.compensated(round(1e9 * time_s), place)
        offset = np.zeros(6)
        offset[0] = 0.3 * np.sin(3 * time_s) - compensated[0, 3]
        delay.learn(offset + noise * SIGMA * rng.normal(size=6), SIGMA)


@pytest.mark.parametrize("lag_s", [-0.05, 0.02, 0.08])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_the_delay_of_a_camera_that_swings_is_found(lag_s: float, noise: float) -> None:
    delay = PoseDelay(0.03)
    swinging(delay, lag_s, 1 / 15, noise)
    assert delay.delay_s == pytest.approx(lag_s, rel=0.25, abs=0.006)


def test_poses_far_apart_tell_no_velocity() -> None:
    delay = PoseDelay(0.03)
    swinging(delay, 0.08, 0.5)
    assert delay.delay_s == 0


def test_stamps_that_go_back_are_no_time_that_passes() -> None:
    delay = PoseDelay(0.03)
    swinging(delay, 0.08, 1 / 15)
    known = delay.delay_s
    place = np.eye(4)
    np.testing.assert_array_equal(delay.compensated(0, place), place)
    np.testing.assert_array_equal(delay.compensated(0, place), place)
    delay.learn(np.zeros(6), SIGMA)
    assert delay.delay_s == known


def test_chance_changes_nothing() -> None:
    delay = PoseDelay(0.03)
    swinging(delay, 0.0, 1 / 15, noise=0.3)
    assert delay.delay_s == 0


def test_what_is_said() -> None:
    assert told(0.004) == ""
    assert "33 ms older than their images" in told(0.033)
    assert "33 ms newer than their images" in told(-0.033)
