"""Depth that is some per cent too long or too short for the given poses."""

from itertools import product

import numpy as np
import pytest
from test_pose_correction import CAMERA, FRAME_NS, recording, shaken, tracked

from spot3d.camera import invert
from spot3d.pose.depth_scale import UNKNOWN, DepthScale
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.evidence import Registered
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import sample_surface
from spot3d.pose.surfel_map import SurfelMap
from spot3d.source.scene.scene import Scene

GIVEN = PoseSettings(provider="given")
ALONE = np.array((0.02, *np.zeros(5)))
"""Nothing but the scale may be wrong, by two per cent."""


def registered(H: np.ndarray, g: np.ndarray, pose_information: np.ndarray, elapsed: float = 1.0) -> Registered:
    """A frame of these equations, whose given pose lies where it was registered, and which tells of pose and scale."""
    whole = np.eye(12)
    whole[:7, :7] = H
    return Registered(whole, np.append(g, np.zeros(5)), pose_information, np.zeros(6), elapsed)


def learn(scale: DepthScale, frame: Registered, path: tuple[float, float] = UNKNOWN) -> float:
    """By what it has changed."""
    return scale.learn(frame, np.zeros(5), path)


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
            last = tracker.track(1 + frame * FRAME_NS // 3, depth, CAMERA, pose)
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
    assert tracker.track(1, depths[0] * np.float32(1.04), CAMERA, None).calibration.depth_factor == 1


def test_chance_changes_nothing() -> None:
    """What lies within a standard deviation of one may be chance."""
    scale = DepthScale(ALONE)
    H, pose_information = np.diag(np.full(7, 1e3)), 1e8 * np.eye(6)
    g = np.append(np.zeros(6), 1e3 * 0.03)
    assert learn(scale, registered(H, g, pose_information)) == 1
    for _ in range(200):
        learn(scale, registered(H, g * (0.03 - np.log(scale.factor)) / 0.03, pose_information))
    assert scale.factor == pytest.approx(1.03, abs=0.005)


@pytest.mark.parametrize(
    ("along", "across", "found"), [(0.03, 0.0, 1.03), (0.03, 0.03, 1.0), (0.1, 0.03, 1.056), (0.1, 0.06, 1.010)]
)
def test_what_is_off_across_the_way_as_much_as_along_it_is_no_scale(along: float, across: float, found: float) -> None:
    """Views a decimetre apart: poses off by 3 mm along that look like depth that is off by three per cent. Of ten per
    cent, which no camera is likely to be off by, less is believed the more is off across."""
    scale, apart = DepthScale(ALONE), np.array([0.1, 0.0, 0.0])
    H, pose_information = np.diag([*np.full(6, 1e6), 1e6 * apart @ apart]), 1e5 * np.eye(6)
    H[:3, 6] = H[6, :3] = 1e6 * apart
    for _ in range(200):
        left = np.log(1 + along) - np.log(scale.factor)
        off = np.array([0.1 * left, 0.1 * across, 0.0])
        g = np.append(1e6 * off, [0.0, 0.0, 0.0, 1e6 * apart @ off])
        learn(scale, registered(H, g, pose_information))
    assert scale.factor == pytest.approx(found, abs=0.004)


@pytest.mark.parametrize(("deviation", "found"), [(0.002, 1.029), (0.01, 1.018), (0.02, 1.004), (np.inf, 1.0)])
def test_how_far_odometry_goes_tells_the_scale_as_far_as_it_is_sure(deviation: float, found: float) -> None:
    """Of three per cent, beside views that tell nothing."""
    scale, nothing = DepthScale(ALONE), np.zeros((7, 7))
    nothing[:6, :6] = np.eye(6)
    for _ in range(2):
        path = (np.log(1.03 / scale.factor), deviation**2) if np.isfinite(deviation) else UNKNOWN
        learn(scale, registered(nothing, np.zeros(7), np.eye(6)), path)
    assert scale.factor == pytest.approx(found, abs=0.002)


def test_what_another_error_may_have_made_is_no_scale() -> None:
    """Views that are as a scale of 3 % makes them, and as a turn of 0.03 does: either is believed by half, at most."""
    H, pose_information, both = np.zeros((12, 12)), 1e8 * np.eye(6), np.eye(12)[6] + np.eye(12)[7]
    H[:6, :6] = np.eye(6)
    H += 1e6 * np.outer(both, both)
    frame = Registered(H, 1e6 * 0.03 * both, pose_information, np.zeros(6), 1.0)
    found = {}
    for turn_sigma in (0.0, 0.02):
        scale = DepthScale(np.array((0.02, turn_sigma, 0, 0, 0, 0)))
        learn(scale, frame)
        found[turn_sigma] = np.log(scale.factor)
    assert found[0.0] == pytest.approx(0.03, abs=0.003)
    assert abs(found[0.02]) <= 0.015


def test_a_map_of_corrected_poses_is_known_as_the_given_ones_have_it() -> None:
    depths, true = recording(0)
    surface, planes, given = sample_surface(depths[0], CAMERA, PoseSettings()), SurfelMap(0.05, 20_000), true[0].copy()
    given[:3, 3] += 0.01, -0.005, 0.003
    planes.insert(surface, true[0], given)
    for as_given, meets in ((False, true[0]), (True, given)):
        H, g, _ = planes.normal_equations(surface, true[0], 0.05, 4.5, as_given=as_given)
        np.testing.assert_allclose(np.linalg.solve(H[:6, :6], g[:6])[:3], (meets - true[0])[:3, 3], atol=2e-3)


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
