"""A camera that looks elsewhere than the given poses and its intrinsics say."""

import numpy as np
import pytest
from test_pose_correction import CAMERA, FRAME_NS, recording, shaken, tracked

from spot3d.calibration import Calibration
from spot3d.pose.evidence import Registered
from spot3d.pose.orientation import Orientation, told
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import sample_surface
from spot3d.pose.surfel_map import SurfelMap
from spot3d.source.scene.scene import Scene
from spot3d.trajectory import rotation_angle, rotation_from_vector

GIVEN = PoseSettings(provider="given")
TRUE_DEPTH = np.array((0.0, *np.full(5, 0.014)))
"""Depth is of the scale that it says; what else may be wrong is so to 0.014."""


def registered(H: np.ndarray, looks: np.ndarray, elapsed: float = 1.0) -> Registered:
    """A frame of these equations (12, 12) whose gradient is (5,) of turn and centre, and whose pose is exact."""
    return Registered(H, np.append(np.zeros(7), looks), 1e8 * np.eye(6), np.zeros(6), elapsed)


TURN = np.radians((1.5, -0.5, 0.5))


def turned(poses: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """The poses of what the camera is turned against by a rotation vector of its axes."""
    given = poses.copy()
    given[:, :3, :3] = poses[:, :3, :3] @ rotation_from_vector(vector).T
    return given


def way(
    seed: int, vector: np.ndarray, metres: float = 0.0, sigma: float = 0.014, centre_sigma: float = 0.02
) -> tuple[np.ndarray, np.ndarray]:
    """The last turn that is found on ten seconds around the built-in scene, and the smearing (n,) of the poses after.

    Smearing: radians by which the last poses are turned against true ones, but for what is alike for all of them.
    """
    frames = range(0, 600, 6)
    scene = Scene(seed, frames=600, intrinsics=CAMERA)
    tracker = make_tracker(GIVEN.model_copy(update={"mount_turn_sigma": sigma, "centre_sigma": centre_sigma}))
    true = np.array([scene.true_pose(frame) for frame in frames])
    given = turned(true, vector)
    if metres:
        given = shaken(given, metres, 40 * metres)
    estimates = [
        tracker.track(1 + frame * FRAME_NS // 3, scene[frame].depth_metres(), CAMERA, pose)
        for frame, pose in zip(frames, given, strict=True)
    ]
    assert {estimate.status for estimate in estimates} == {"ok"}
    off = np.array([e.T_world_camera[:3, :3] @ t[:3, :3].T for e, t in zip(estimates, true, strict=True)])[60:]
    u, _, vt = np.linalg.svd(off.mean(axis=0))
    return np.array(estimates[-1].calibration.turn), rotation_angle(off @ (u @ vt).T)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_camera_that_is_turned_smears_half_as_much_at_most(seed: int) -> None:
    found, left = way(seed, TURN, centre_sigma=0.0)
    nothing, before = way(seed, TURN, sigma=0.0, centre_sigma=0.0)
    assert not nothing.any()
    assert found @ TURN > 0.4 * TURN @ TURN
    assert left.mean() < 0.5 * before.mean()


@pytest.mark.parametrize("metres", [0.0, 0.01])
def test_a_camera_that_is_not_turned_stays(metres: float) -> None:
    found, _ = way(0, np.zeros(3), metres)
    assert np.degrees(np.linalg.norm(found)) < 0.3


def test_depth_of_another_scale_is_no_turn() -> None:
    depths, true = recording(0)
    last = tracked(make_tracker(GIVEN), [depth * np.float32(0.97) for depth in depths], true)[-1]
    assert np.degrees(np.linalg.norm(last.calibration.turn)) < 0.3


def test_the_last_equations_are_the_turn_of_all_cameras() -> None:
    """Two views of one surface by cameras that are turned: they meet where both are turned back."""
    depths, true = recording(0)
    settings, first, second = PoseSettings(), 0, 20
    seen = [sample_surface(depths[k], CAMERA, settings) for k in (first, second)]
    small = np.radians((0.3, -0.2, 0.1))
    given = turned(true, small)
    planes = SurfelMap(0.05, 20_000)
    planes.insert(seen[0], given[first])
    H, g, _ = planes.normal_equations(seen[1], given[second], 0.05, 4.5, as_given=True)
    assert H.shape == (12, 12)
    before = g[7:10] @ np.linalg.pinv(H[7:10, 7:10]) @ g[7:10]
    along = H[7:10, 7:10] @ small
    assert g[7:10] @ along / (along @ along) == pytest.approx(1, abs=0.25)
    planes.look_elsewhere(np.append(small, (0.0, 0.0)))
    H, g, _ = planes.normal_equations(seen[1], true[second], 0.05, 4.5, as_given=True)
    assert g[7:10] @ np.linalg.pinv(H[7:10, 7:10]) @ g[7:10] < 0.1 * before


def test_the_last_equations_are_the_principal_point_of_all_cameras() -> None:
    """Two views of one surface by wrong intrinsics: they meet where both are mended."""
    depths, true = recording(0)
    settings, views, offset = PoseSettings(), (0, 20), np.array((0.002, -0.003))
    told_camera, planes = Calibration(centre=(-0.002, 0.003)).camera(CAMERA), SurfelMap(0.05, 20_000)
    seen = [sample_surface(depths[k], told_camera, settings) for k in views]
    planes.insert(seen[0], true[views[0]])
    H, g, _ = planes.normal_equations(seen[1], true[views[1]], 0.05, 4.5, as_given=True)
    before = g[10:] @ np.linalg.pinv(H[10:, 10:]) @ g[10:]
    along = H[10:, 10:] @ offset
    assert g[10:] @ along / (along @ along) == pytest.approx(1, abs=0.3)
    planes.look_elsewhere(np.array((0.0, 0.0, 0.0, *offset)))
    right = sample_surface(depths[views[1]], CAMERA, settings)
    H, g, _ = planes.normal_equations(right, true[views[1]], 0.05, 4.5, as_given=True)
    assert g[10:] @ np.linalg.pinv(H[10:, 10:]) @ g[10:] < 0.1 * before


def test_noise_of_depth_alone_is_no_turn_and_no_scale() -> None:
    """A map of one view, seen again from there with other noise: nothing about the camera can be told by it."""
    depths, true = recording(0)
    settings, rng = PoseSettings(), np.random.default_rng(0)
    noise = 1 + 0.004 * rng.normal(size=depths[0].shape).astype(np.float32)
    planes = SurfelMap(0.05, 20_000)
    planes.insert(sample_surface(depths[0], CAMERA, settings), true[0])
    again = sample_surface(depths[0] * noise, CAMERA, settings)
    H, g, _ = planes.normal_equations(again, true[0], 0.05, 4.5, as_given=True)
    assert abs(g[6]) < 1e-6
    known = H[7:10, 7:10] + 0.01**-2 * np.eye(3)
    assert np.degrees(np.linalg.norm(np.linalg.solve(known, g[7:10]))) < 0.05


def test_chance_turns_nothing() -> None:
    """What is no further from none than chance makes it may be chance; what is sure is found."""
    mount = Orientation(TRUE_DEPTH)
    H, looks = np.diag([*np.full(7, 1e3), *np.full(5, 4e3)]), np.append(TURN, (0.0, 0.03))
    assert not mount.learn(registered(H, 4e3 * looks, 0.1), 0.0).any()
    for _ in range(300):
        mount.learn(registered(H, 4e3 * (looks - mount.vector)), 0.0)
    np.testing.assert_allclose(mount.vector, looks, atol=0.004)


@pytest.mark.parametrize(("deviations", "found"), [(0.9, False), (1.8, True)])
def test_all_directions_together_tell_what_is_chance(deviations: float, found: bool) -> None:
    """Each of five unknowns lies so many standard deviations from none."""
    looks, known = Orientation(TRUE_DEPTH), 1.0 / 0.005**2
    gradient = deviations * np.sqrt(known + 0.014**-2) * np.ones(5)
    looks.learn(registered(np.diag([*np.full(7, 1e3), *np.full(5, known)]), gradient), 0.0)
    assert looks.vector.any() == found


@pytest.mark.parametrize(("sigmas", "free"), [((0.014, 0.0), slice(0, 3)), ((0.0, 0.02), slice(3, 5))])
def test_what_counts_as_exact_stays(sigmas: tuple[float, float], free: slice) -> None:
    turn, centre = sigmas
    looks = Orientation(np.array((0.02, turn, turn, turn, centre, centre)))
    looks.learn(registered(np.diag([*np.full(7, 1e3), *np.full(5, 4e5)]), np.full(5, 8e3)), 0.0)
    assert looks.vector[free] == pytest.approx(0.02, abs=0.002)
    assert np.count_nonzero(looks.vector) == len(looks.vector[free])


@pytest.mark.parametrize("rows", [16, -16])
def test_a_principal_point_that_is_off_smears_half_as_much_at_most(rows: float) -> None:
    """So many pixels of 640 too low or too high: what a driver's is from a calibrated one."""
    offset = rows / 640 * CAMERA.width / CAMERA.fy
    told_camera = Calibration(centre=(0.0, -offset)).camera(CAMERA)
    scene, tracker = Scene(0, frames=600, intrinsics=CAMERA), make_tracker(GIVEN)
    estimates = [
        tracker.track(1 + k * FRAME_NS // 3, scene[k].depth_metres(), told_camera, scene.true_pose(k))
        for k in range(0, 600, 6)
    ]
    known = estimates[-1].calibration
    left = offset - known.centre[1] + known.turn[0]
    assert abs(left) < 0.5 * abs(offset)


@pytest.mark.parametrize(("factor", "rows"), [(0.97, 16), (1.03, -16)])
def test_depths_scale_and_the_principal_point_are_told_apart(factor: float, rows: float) -> None:
    """A principal point that is too low makes depth that is too short look true."""
    offset = rows / 640 * CAMERA.width / CAMERA.fy
    told_camera = Calibration(centre=(0.0, -offset)).camera(CAMERA)
    scene, tracker = Scene(0, frames=600, intrinsics=CAMERA), make_tracker(GIVEN)
    for k in range(0, 600, 6):
        depth = scene[k].depth_metres() * np.float32(factor)
        known = tracker.track(1 + k * FRAME_NS // 3, depth, told_camera, scene.true_pose(k)).calibration
    assert abs(offset - known.centre[1] + known.turn[0]) < 0.5 * abs(offset)
    assert factor * known.depth_factor == pytest.approx(1, abs=0.011)


def test_a_turn_is_told_in_degrees_about_the_cameras_axes() -> None:
    assert told(Calibration(turn=(0.004, 0.005, 0.0), centre=(0.0, 0.008))) == ""
    x, y, z = TURN.tolist()
    turned_by = "turned by 1.7 deg against the given poses (1.5, -0.5, 0.5 about its x, y, z)"
    assert turned_by in told(Calibration(turn=(x, y, z)))
    both = told(Calibration(turn=(x, y, z), centre=(0.001, -0.03)))
    assert turned_by in both
    assert "cx and cy are too large by +0.1 and -3.0 % of the focal length" in both
