"""A camera that looks elsewhere than the given poses and its intrinsics say."""

import numpy as np
import pytest
from test_pose_correction import CAMERA, FRAME_NS, recording, shaken, tracked

from made_frame import frame_of
from spot3d.calibration import Calibration
from spot3d.pose.common_errors import CommonErrors
from spot3d.pose.orientation import decided, notice
from spot3d.pose.providers import make_tracker
from spot3d.pose.registration import judged
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import sample_surface
from spot3d.pose.surfel_map import SurfelMap
from spot3d.source.scene.scene import Scene
from spot3d.trajectory import rotation_angle, rotation_from_vector

GIVEN = PoseSettings(provider="given")
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
        tracker.track(frame_of(1 + frame * FRAME_NS // 3, scene[frame].depth_metres(), CAMERA, pose))
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


@pytest.mark.parametrize(
    "vector", [np.append(np.radians((0.6, -0.4, 0.2)), (0.0, 0.0)), np.array((0, 0, 0, 0.01, -0.015))]
)
def test_a_map_follows_where_the_camera_looks(vector: np.ndarray) -> None:
    """What a turned camera, or one of wrong intrinsics, has seen lies where the next view by right ones sees it."""
    depths, true = recording(0)
    settings, planes = PoseSettings(), SurfelMap(0.05, 20_000)
    told_camera = Calibration(centre=(-vector[3], -vector[4])).camera(CAMERA)
    planes.insert(sample_surface(depths[0], told_camera, settings), turned(true, vector[:3])[0])
    right, away = sample_surface(depths[20], CAMERA, settings), []
    for change in (np.zeros(5), vector):
        planes.look_elsewhere(change)
        away.append(judged(planes, right, true[20], 0.05).residual)
    assert away[1] < 0.6 * away[0]


def errors(looks: np.ndarray, known: float, sigmas: tuple[float, float] = (0.014, 0.014)) -> CommonErrors:
    """Depth is of the scale that it says; turn and centre are these (5,), each known to so much; sigmas: as was told of
    the turn and the centre, 0 = exact."""
    told_sigmas = np.repeat(sigmas, (3, 2))
    free = np.flatnonzero(told_sigmas)
    seen = known**-2.0 * np.eye(len(free)) - np.diag(told_sigmas[free] ** -2.0)
    pull = known**-2.0 * looks[free]
    return CommonErrors(1 + free, told_sigmas[free], np.zeros(1), pull[None], seen[None])


def test_chance_turns_nothing() -> None:
    """What is no further from none than chance makes it may be chance; what is sure is found."""
    looks = np.append(TURN, (0.0, 0.03))
    assert not decided(errors(0.1 * looks, 0.01), np.zeros(5), 0.0).any()
    found = decided(errors(looks, 0.0005), np.zeros(5), 0.0)
    np.testing.assert_allclose(found, looks, atol=1e-4)
    assert decided(errors(1.01 * looks, 0.0005), found, 0.0) is found


@pytest.mark.parametrize(("deviations", "found"), [(1.0, False), (3.5, True)])
def test_all_directions_together_tell_what_is_chance(deviations: float, found: bool) -> None:
    """Each of five unknowns lies so many standard deviations from none."""
    looks = decided(errors(np.full(5, deviations * 0.005), 0.005), np.zeros(5), 0.0)
    assert (np.linalg.norm(looks) > 0.8 * deviations * 0.005 * 5**0.5) == found


@pytest.mark.parametrize(("sigmas", "free"), [((0.014, 0.0), slice(0, 3)), ((0.0, 0.02), slice(3, 5))])
def test_what_counts_as_exact_stays(sigmas: tuple[float, float], free: slice) -> None:
    looks = decided(errors(np.full(5, 0.02), 0.002, sigmas), np.zeros(5), 0.0)
    assert looks[free] == pytest.approx(0.02, abs=0.002)
    assert np.count_nonzero(looks) == len(looks[free])


def test_where_the_scale_is_another_one_so_is_the_turn() -> None:
    """Scale and turn that look alike: where the scale is not applied, the turn explains it all."""
    known = 0.002**-2.0 * (np.eye(6) + 0.9 * (np.eye(6)[[0]].T @ np.eye(6)[[1]] + np.eye(6)[[1]].T @ np.eye(6)[[0]]))
    pull, sigmas = known @ np.array((0.02, *np.zeros(5))), np.full(6, 0.02)
    seen = CommonErrors(np.arange(6), sigmas, np.zeros(1), pull[None], (known - np.diag(sigmas**-2.0))[None])
    assert not decided(seen, np.zeros(5), 0.02).any()
    assert decided(seen, np.zeros(5), 0.0)[0] == pytest.approx(0.018, abs=0.001)


@pytest.mark.parametrize("rows", [16, -16])
def test_a_principal_point_that_is_off_smears_half_as_much_at_most(rows: float) -> None:
    """So many pixels of 640 too low or too high: what a driver's is from a calibrated one."""
    offset = rows / 640 * CAMERA.width / CAMERA.fy
    told_camera = Calibration(centre=(0.0, -offset)).camera(CAMERA)
    scene, tracker = Scene(0, frames=600, intrinsics=CAMERA), make_tracker(GIVEN)
    estimates = [
        tracker.track(frame_of(1 + k * FRAME_NS // 3, scene[k].depth_metres(), told_camera, scene.true_pose(k)))
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
        known = tracker.track(frame_of(1 + k * FRAME_NS // 3, depth, told_camera, scene.true_pose(k))).calibration
    assert abs(offset - known.centre[1] + known.turn[0]) < 0.5 * abs(offset)
    assert factor * known.depth_factor == pytest.approx(1, abs=0.011)


def test_a_turn_is_told_in_degrees_about_the_cameras_axes() -> None:
    assert notice(Calibration(turn=(0.004, 0.005, 0.0), centre=(0.0, 0.008))) == ""
    x, y, z = TURN.tolist()
    turned_by = "rotated by 1.7 deg against the given poses (1.5, -0.5, 0.5 deg about its x, y, z axes)"
    assert turned_by in notice(Calibration(turn=(x, y, z)))
    both = notice(Calibration(turn=(x, y, z), centre=(0.001, -0.03)))
    assert turned_by in both
    assert "cx and cy are too large by +0.1 and -3.0 % of the focal length" in both
