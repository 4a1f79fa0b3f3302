"""Depth that is some per cent too long or too short for the given poses."""

import numpy as np
import pytest
from test_pose_correction import CAMERA, recording, shaken, tracked

from spot3d.camera import invert
from spot3d.pose.depth_scale import DepthScale
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import sample_surface
from spot3d.pose.surfel_map import SurfelMap


def followed(seed: int, factor: float, metres: float = 0.0, sigma: float = 0.02) -> list[PoseEstimate]:
    """The built-in scene with its depth times `factor`, its poses shaken by so many metres."""
    depths, true = recording(seed)
    given = shaken(true, metres, 40 * metres) if metres else true
    tracker = make_tracker(PoseSettings(provider="given", depth_scale_sigma=sigma))
    return tracked(tracker, [depth * np.float32(factor) for depth in depths], given)


@pytest.mark.parametrize("factor", [0.96, 0.98, 1.04])
def test_most_of_the_scale_is_found_in_six_seconds(factor: float) -> None:
    estimates = followed(0, factor)
    assert estimates[0].depth_factor == 1
    assert factor * estimates[-1].depth_factor == pytest.approx(1, abs=0.011)
    assert {estimate.status for estimate in estimates} == {"ok"}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("metres", [0.0, 0.01])
def test_depth_that_is_true_stays(seed: int, metres: float) -> None:
    assert max(abs(estimate.depth_factor - 1) for estimate in followed(seed, 1.0, metres)) <= 0.006


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_with_shaken_poses_depth_becomes_no_worse(factor: float) -> None:
    last = followed(0, factor, 0.01)[-1]
    assert abs(factor * last.depth_factor - 1) <= abs(factor - 1) + 1e-6


def test_poses_come_out_as_they_were_given_where_depth_alone_is_wrong() -> None:
    _, true = recording(0)
    corrected = np.array([estimate.T_world_camera for estimate in followed(0, 1.04)])
    assert np.linalg.norm(corrected[:, :3, 3] - true[:, :3, 3], axis=1).max() < 0.01


def test_depth_is_taken_as_it_is_where_it_is_told_to_be_exact() -> None:
    assert {estimate.depth_factor for estimate in followed(0, 1.04, sigma=0.0)} == {1.0}


def test_odometry_has_the_scale_of_its_depth() -> None:
    depths, _ = recording(0)
    tracker = make_tracker(PoseSettings(provider="kiss"))
    assert tracker.track(1, depths[0] * np.float32(1.04), CAMERA, None).depth_factor == 1


def test_chance_changes_nothing() -> None:
    """What lies within two standard deviations of one may be chance."""
    scale = DepthScale(0.02)
    H, pose_information = np.diag(np.full(7, 1e3)), 1e8 * np.eye(6)
    g = np.append(np.zeros(6), 1e3 * 0.03)
    assert scale.learn(H, g, pose_information, np.zeros(6), 1.0) == 1
    for _ in range(200):
        scale.learn(H, g * (0.03 - np.log(scale.factor)) / 0.03, pose_information, np.zeros(6), 1.0)
    assert scale.factor == pytest.approx(1.03, abs=0.005)


def test_what_noisy_poses_look_like_is_no_scale() -> None:
    """Poses that are off by 1 cm, seen from places a decimetre apart, look like depth that is off by a per cent."""
    scale = DepthScale(0.02)
    H, pose_information = np.diag([*np.full(3, 1e6), *np.full(3, 1e6), 3e4]), 1e4 * np.eye(6)
    for _ in range(200):
        scale.learn(H, np.append(np.zeros(6), 3e4 * 0.01), pose_information, np.zeros(6), 1.0)
    assert scale.factor == 1


def test_the_seventh_equation_is_the_growth_of_depth() -> None:
    """Two views of one surface from two places, with depth too long: they meet where it shrinks."""
    depths, true = recording(0)
    first, second, factor = 0, 20, 1.01
    seen = [sample_surface(depths[k] * np.float32(factor), CAMERA, PoseSettings()) for k in (first, second)]
    planes = SurfelMap(0.05, 20_000)
    planes.insert(seen[0], true[first])
    H, g, (_, matched, _) = planes.normal_equations(seen[1], true[second], 0.05, 4.5)
    assert matched > 300
    assert np.linalg.norm((invert(true[first]) @ true[second])[:3, 3]) > 0.1
    assert g[6] / H[6, 6] == pytest.approx(1 / factor - 1, abs=0.004)
    planes.rescale(1 / factor)
    shorter = sample_surface(depths[second], CAMERA, PoseSettings())
    H, g, (_, again, _) = planes.normal_equations(shorter, true[second], 0.05, 4.5)
    assert again > 0.6 * matched  # what moved into a voxel that was taken is seen again with the next frame
    assert g[6] / H[6, 6] == pytest.approx(0, abs=0.002)
    assert planes.count == np.count_nonzero(planes.keys != -1)
