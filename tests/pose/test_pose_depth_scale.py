"""Depth that is some per cent too long or too short for the given poses."""

from itertools import product

import numpy as np
import pytest
from test_pose_correction import CAMERA, FRAME_NS, recording, shaken, tracked

from made_frame import frame_of
from spot3d.pose.common_errors import CommonErrors
from spot3d.pose.depth_scale import decided
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.source.scene.scene import Scene

GIVEN = PoseSettings(provider="given")


def followed(seed: int, factor: float, metres: float = 0.0, sigma: float = 0.02) -> list[PoseEstimate]:
    """The built-in scene with its depth times `factor`, its poses shaken by so many metres."""
    depths, true = recording(seed)
    given = shaken(true, metres, 40 * metres) if metres else true
    tracker = make_tracker(GIVEN.model_copy(update={"depth_scale_sigma": sigma}))
    return tracked(tracker, [depth * np.float32(factor) for depth in depths], given)


@pytest.mark.parametrize("factor", [0.96, 0.98, 1.04])
def test_most_of_the_scale_is_found_in_six_seconds(factor: float) -> None:
    estimates = followed(0, factor)
    assert estimates[0].calibration.depth_factor == 1
    assert factor * estimates[-1].calibration.depth_factor == pytest.approx(1, abs=0.011)
    assert {estimate.status for estimate in estimates} == {"ok"}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("metres", [0.0, 0.01])
def test_depth_that_is_true_stays(seed: int, metres: float) -> None:
    assert max(abs(estimate.calibration.depth_factor - 1) for estimate in followed(seed, 1.0, metres)) <= 0.006


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_with_shaken_poses_depth_becomes_no_worse(factor: float) -> None:
    last = followed(0, factor, 0.01)[-1]
    assert abs(factor * last.calibration.depth_factor - 1) <= abs(factor - 1) + 1e-6


def test_most_of_the_scale_is_found_though_poses_are_shaken() -> None:
    left, frames = [], range(0, 600, 6)
    for seed, factor in product((0, 1), (0.97, 1.03)):
        scene, tracker = Scene(seed, frames=len(frames) * 6, intrinsics=CAMERA), make_tracker(GIVEN)
        given = shaken(np.array([scene.true_pose(frame) for frame in frames]), 0.01, 0.4)
        for frame, pose in zip(frames, given, strict=True):
            depth = scene[frame].depth_metres() * np.float32(factor)
            last = tracker.track(frame_of(1 + frame * FRAME_NS // 3, depth, CAMERA, pose))
        left.append(abs(factor * last.calibration.depth_factor - 1))
    assert np.mean(left) <= 0.015


def test_poses_come_out_as_they_were_given_where_depth_alone_is_wrong() -> None:
    _, true = recording(0)
    corrected = np.array([estimate.T_world_camera for estimate in followed(0, 1.04)])
    assert np.linalg.norm(corrected[:, :3, 3] - true[:, :3, 3], axis=1).max() < 0.01


def test_depth_is_taken_as_it_is_where_it_is_told_to_be_exact() -> None:
    assert {estimate.calibration.depth_factor for estimate in followed(0, 1.04, sigma=0.0)} == {1.0}


def test_odometry_has_the_scale_of_its_depth() -> None:
    depths, _ = recording(0)
    tracker = make_tracker(PoseSettings(provider="kiss"))
    assert tracker.track(frame_of(1, depths[0] * np.float32(1.04), CAMERA)).calibration.depth_factor == 1


def errors(log_scale: float, information: float) -> CommonErrors:
    """Nothing but the scale is unknown; information: with that of what is told, two per cent."""
    pull, seen = np.array([[information * log_scale]]), np.array([[[information - 0.02**-2]]])
    return CommonErrors(np.array([0]), np.array([0.02]), np.zeros(1), pull, seen)


def test_chance_changes_nothing() -> None:
    """What lies within a standard deviation of one may be chance; what is surely something else is followed."""
    assert decided(errors(0.005, 0.005**-2), 1.0) == 1
    found = decided(errors(0.03, 0.003**-2), 1.0)
    assert found == pytest.approx(np.exp(0.03), rel=1e-4)
    assert decided(errors(0.0305, 0.003**-2), found) == found
    assert decided(errors(0.001, 0.003**-2), found) < 0.98 * found


def test_a_scale_is_followed_as_far_as_it_is_probable() -> None:
    """And not at all where it is more probable that there is none."""
    shares = []
    for deviations in (1.5, 2.6, 3.0, 3.5):
        found = decided(errors(deviations * 0.006, 0.006**-2), 1.0)
        shares.append(np.log(found) / (deviations * 0.006))
    assert np.diff(shares).min() > 0
    assert shares[0] == 0.0
    assert 0.5 < shares[1] < 0.9 < shares[-1] < 1


def test_no_camera_is_off_by_more_than_a_tenth() -> None:
    assert np.log(decided(errors(2.0, 0.001**-2), 1.0)) == pytest.approx(0.1)
