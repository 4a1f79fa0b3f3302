"""Given poses corrected against the map: on the built-in scene, in front of a bare plane, and where they jump."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from made_frame import frame_of
from spot3d.camera import Intrinsics
from spot3d.depth_noise import KINECT_V1
from spot3d.pose.correction import CorrectedPoses
from spot3d.pose.estimate import PoseEstimate, PoseTracker
from spot3d.pose.measured_noise import MeasuredNoise
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.source.scene.scene import Scene
from spot3d.trajectory import ate, rotation_angle, rotation_from_vector, rpe

CAMERA = Intrinsics(146.25, 146.25, 80.0, 60.0, 160, 120)
FRAME_NS = 100_000_000
EVERY, FRAMES = 3, 60
SIGMA = PoseSettings().given_sigma


@cache
def recording(seed: int) -> tuple[list[NDArray[np.float32]], NDArray[np.float64]]:
    """Depth of frames of the built-in scene, ten a second, and their true poses (n, 4, 4)."""
    scene = Scene(seed, frames=EVERY * FRAMES, intrinsics=CAMERA)
    frames = [scene[EVERY * index] for index in range(FRAMES)]
    return [frame.depth_metres() for frame in frames], np.array([scene.true_pose(EVERY * i) for i in range(FRAMES)])


def shaken(true: NDArray[np.float64], metres: float, degrees: float, seed: int = 0) -> NDArray[np.float64]:
    """Poses that are wrong by these standard deviations of each axis, smoothly, alike for a third of a second."""
    rng, keep = np.random.default_rng(seed), np.exp(-FRAME_NS * 1e-9 / 0.333)
    sigma = np.repeat((metres, np.radians(degrees)), 3)
    wrong, poses = sigma * rng.normal(size=6), true.copy()
    for pose in poses:
        wrong = keep * wrong + np.sqrt(1 - keep**2) * sigma * rng.normal(size=6)
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = rotation_from_vector(wrong[3:]), wrong[:3]
        pose[:] = pose @ motion
    return poses


def tracked(
    tracker: PoseTracker, depths: list[NDArray[np.float32]], given: NDArray[np.float64], first: int = 0
) -> list[PoseEstimate]:
    return [
        tracker.track(frame_of(1 + (first + index) * FRAME_NS, depth, CAMERA, pose))
        for index, (depth, pose) in enumerate(zip(depths, given, strict=True))
    ]


def poses_of(estimates: list[PoseEstimate]) -> NDArray[np.float64]:
    assert {estimate.status for estimate in estimates} == {"ok"}
    return np.array([estimate.T_world_camera for estimate in estimates])


def corrector(given_sigma: float = SIGMA) -> PoseTracker:
    return make_tracker(PoseSettings(provider="given", given_sigma=given_sigma))


def distances(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1))


@pytest.mark.parametrize("seed", [0, 1])
def test_exact_poses_stay(seed: int) -> None:
    depths, true = recording(seed)
    corrected = poses_of(tracked(corrector(), depths, true))
    assert distances(corrected, true).max() < 0.0005
    assert np.degrees(rotation_angle(np.linalg.inv(true) @ corrected)).max() < 0.02
    assert distances(corrected, true)[-10:].max() < 1e-9


def test_poses_that_drift_are_held_by_the_map() -> None:
    """As a robot's own odometry: what it sees again is where it was."""
    depths, true = recording(0)
    left = []
    for seed in range(4):
        given = true.copy()
        given[:, :3, 3] += np.cumsum(0.004 * np.random.default_rng(seed).normal(size=(len(true), 3)), axis=0)
        corrected = poses_of(tracked(corrector(), depths, given))
        left.append(ate(true, corrected)["rmse"] / ate(true, given)["rmse"])
    assert np.mean(left) < 0.5


@pytest.mark.parametrize(("metres", "degrees"), [(0.005, 0.2), (0.01, 0.4), (0.02, 0.8)])
def test_shaken_poses_come_nearer_to_the_truth(metres: float, degrees: float) -> None:
    depths, true = recording(0)
    given = shaken(true, metres, degrees)
    estimates = tracked(corrector(), depths, given)
    corrected = poses_of(estimates)
    assert not any(estimate.restarted for estimate in estimates)
    assert ate(true, corrected)["rmse"] < 0.75 * ate(true, given)["rmse"]
    for before, after in zip(rpe(true, given), rpe(true, corrected), strict=True):
        assert after["rmse"] < 0.9 * before["rmse"]
    # The world stays that of the given poses.
    assert distances(corrected, given).max() < 5 * metres
    assert distances(corrected, true).mean() < distances(given, true).mean()


@pytest.mark.parametrize("seed", [0, 1])
def test_depth_that_is_bent_is_trusted_less(seed: int) -> None:
    """Bent by up to 2 % in waves, which stay where they are in the image wherever the camera looks."""
    depths, true = recording(seed)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    waves = (1 + 0.02 * np.sin(u / 12) * np.cos(v / 9)).astype(np.float32)
    given = shaken(true, 0.01, 0.4)
    straight, bent = (
        ate(true, poses_of(tracked(corrector(), seen, given)))["rmse"] / ate(true, given)["rmse"]
        for seen in (depths, [depth * waves for depth in depths])
    )
    assert straight < 0.8 * bent
    assert bent < 0.95


@pytest.mark.parametrize("seed", [0, 1])
def test_the_map_says_where_earlier_poses_lie_by_now(seed: int) -> None:
    depths, true = recording(seed)
    estimates = tracked(corrector(), depths, shaken(true, 0.02, 0.8, seed))
    corrected = poses_of(estimates)
    maps = [estimate.T_world_map for estimate in estimates]
    assert maps[-1] is not None
    better = np.array([maps[-1] @ np.linalg.inv(T) @ pose for T, pose in zip(maps, corrected, strict=True)])

    def scatter(poses: NDArray[np.float64]) -> float:
        """How far apart, metres, the frames put what lies a metre in front of the camera amid the run."""
        place = true[FRAMES // 2] @ (0, 0, 1, 1)
        placed = (poses @ np.linalg.inv(true) @ place)[10:]  # before that the noise of the poses is not known
        return float(np.sqrt(placed.var(axis=0)[:3].mean()))

    assert scatter(better) < 0.9 * scatter(corrected)


def test_without_uncertainty_poses_are_taken_as_they_are() -> None:
    depths, true = recording(0)
    given = shaken(true, 0.01, 0.4)
    plain = poses_of(tracked(corrector(0.0), depths, given))
    np.testing.assert_allclose(plain, given, atol=1e-12)
    assert not isinstance(corrector(0.0), CorrectedPoses)


def test_two_runs_are_identical() -> None:
    depths, true = recording(0)
    given = shaken(true, 0.01, 0.4)[:20]
    first, second = (poses_of(tracked(corrector(), depths[:20], given)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_along_a_bare_plane_the_given_pose_decides(seed: int) -> None:
    true = np.tile(np.eye(4), (40, 1, 1))
    given = shaken(true, 0.01, 0.4, seed)
    rng = np.random.default_rng(3)
    depth = 1.525  # amid the voxels of the map
    noise = KINECT_V1.sigma(depth) * rng.normal(size=(40, *CAMERA.shape))
    estimates = tracked(corrector(), list((depth + noise).astype(np.float32)), given)
    corrected = poses_of(estimates)
    # A registration that slides along the plane, by some decimetres, is no jump of the given pose.
    assert not any(estimate.restarted for estimate in estimates)
    off = (np.linalg.inv(given) @ corrected)[10:]
    # Depth tells the distance from the plane and its tilt, but nothing of x and y and the turn about its normal.
    assert np.abs(off[:, :2, 3]).max() < 1e-3
    assert np.abs(off[:, 1, 0]).max() < 1e-3
    # The map itself moves to the mean of the given poses, but slowly: frame by frame it stays.
    for row, column, share in ((2, 3, 0.4), (1, 2, 0.8), (0, 2, 0.8)):
        moves = [np.std(np.diff(poses[10:, row, column])) for poses in (given, corrected)]
        assert moves[1] < share * moves[0]


@pytest.mark.parametrize("metres", [0.15, 0.5, 5.0])
def test_a_jump_of_the_given_poses_is_followed(metres: float) -> None:
    depths, true = recording(0)
    jumped = shaken(true, 0.005, 0.2)
    jumped[30:, :3, 3] += metres * np.array((0.6, 0.0, 0.8))
    estimates = tracked(corrector(), depths, jumped)
    assert sum(estimate.restarted for estimate in estimates) == 1
    assert distances(poses_of(estimates), jumped).max() < 0.03
    # What was seen before the jump does not jump.
    places = np.array([estimate.T_world_map for estimate in estimates])[:, :3, 3]
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.002


def test_a_view_that_the_map_does_not_know_takes_the_given_pose() -> None:
    depths, true = recording(0)
    given = shaken(true, 0.01, 0.4)
    tracker = corrector()
    tracked(tracker, depths[:10], given[:10])
    covered = [np.full(CAMERA.shape, 0.3, np.float32), np.zeros(CAMERA.shape, np.float32)]
    estimates = tracked(tracker, covered, given[10:12], first=10)
    np.testing.assert_allclose(poses_of(estimates), given[10:12], atol=1e-12)
    # The map is still there.
    after = tracked(tracker, depths[12:14], given[12:14], first=12)
    assert not any(estimate.restarted for estimate in after)
    assert distances(poses_of(after), given[12:14]).min() > 1e-4


def test_nothing_to_see_at_first() -> None:
    depths, true = recording(0)
    tracker = corrector()
    tracked(tracker, [np.zeros(CAMERA.shape, np.float32)] * 8, true[:8])
    estimates = tracked(tracker, depths[8:12], true[8:12], first=8)
    assert not any(estimate.restarted for estimate in estimates)
    assert distances(poses_of(estimates), true[8:12]).max() < 0.003


def test_bad_poses_are_lost_and_harm_nothing() -> None:
    depths, true = recording(0)
    bent = true[5].copy()
    bent[0, 0] = 2.0
    tracker = corrector()
    tracked(tracker, depths[:5], true[:5])
    for bad in (np.full((4, 4), np.nan), bent, None):
        estimate = tracker.track(frame_of(1 + 5 * FRAME_NS, depths[5], CAMERA, bad))
        assert estimate.status == "lost"
        assert estimate.reason
    after = tracked(tracker, depths[5:10], true[5:10], first=5)
    assert distances(poses_of(after), true[5:10]).max() < 0.001


def test_a_stamp_that_goes_back_begins_anew() -> None:
    depths, true = recording(0)
    tracker = corrector()
    tracked(tracker, depths[:5], true[:5])
    estimate = tracker.track(frame_of(1, depths[0], CAMERA, true[0]))
    assert (estimate.status, estimate.restarted) == ("ok", True)
    np.testing.assert_allclose(estimate.T_world_camera, true[0], atol=1e-12)


@pytest.mark.parametrize("scale", [0.0, 0.1, 0.5, 1.0])
def test_noise_is_measured(scale: float) -> None:
    rng, noise = np.random.default_rng(1), MeasuredNoise(1e-4)
    # Registrations that know three directions to a tenth of the stated uncertainty, and nothing of the others.
    information = np.diag((100.0, 100.0, 100.0, 0.0, 0.0, 0.0))
    measured = [noise.measured(np.hypot(scale, 0.1) * rng.normal(size=6), information, 1 / 30) for _ in range(600)]
    assert np.sqrt(np.median(measured[100:])) == pytest.approx(scale, rel=0.2, abs=0.05)


@pytest.mark.parametrize("pause_s", [10, 600])
def test_after_a_pause_the_world_does_not_follow_a_single_pose(pause_s: int) -> None:
    depths, true = recording(0)
    order = [*range(FRAMES), *range(FRAMES - 2, -1, -1)]
    left = []
    for seed in range(3):
        given, tracker, estimates = shaken(true[order], 0.01, 0.4, seed), corrector(), list[PoseEstimate]()
        for number, row in enumerate(order):
            stamp = 1 + number * FRAME_NS + (pause_s * 10**9 if number >= FRAMES else 0)
            estimates.append(tracker.track(frame_of(stamp, depths[row], CAMERA, given[number])))
        slid = distances(*(np.array([one.T_world_map for one in estimates[k : k + 1]]) for k in (FRAMES - 1, FRAMES)))
        left.append(float(slid[0]))
    assert np.mean(left) < 0.003


@pytest.mark.parametrize(("rate", "metres"), [(60, 0.02), (90, 0.01)])
def test_noise_of_given_poses_is_no_jump_however_fast_frames_come(rate: int, metres: float) -> None:
    """Within what is stated of them a camera may seem to be faster than any is."""
    depths, true = recording(0)
    rng, tracker, restarts = np.random.default_rng(0), corrector(), 0
    for number in range(120):
        given = true[number // 20].copy()
        given[:3, 3] += metres * rng.normal(size=3)
        stamp = 1 + number * 10**9 // rate
        restarts += tracker.track(frame_of(stamp, depths[number // 20], CAMERA, given)).restarted
    assert restarts == 0
