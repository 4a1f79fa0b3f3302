"""Given poses that are older or newer than their images."""

import numpy as np
import pytest
from numpy.typing import NDArray
from test_pose_correction import CAMERA, shaken

from made_frame import frame_of
from spot3d.pose.delay import PoseDelay, notice
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import Surface
from spot3d.source.scene.scene import Scene
from spot3d.trajectory import rotation_from_vector

RATE, SECONDS, LATE = 30, 9, 3


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
        tracker.track(frame_of(int(1e9 * frame / RATE), scene[frame].depth_metres(), CAMERA, pose))
        for frame, pose in zip(frames, given, strict=True)
    ]
    assert {estimate.status for estimate in estimates} == {"ok"}
    return estimates, true, given


@pytest.mark.parametrize("late", [-LATE, LATE])
def test_poses_that_are_late_or_early_are_put_in_time(late: int) -> None:
    estimates, true, given = followed(late)
    assert estimates[0].delay_s == 0
    assert estimates[-1].delay_s == pytest.approx(late / RATE, rel=0.1)
    corrected = np.array([estimate.T_world_camera for estimate in estimates])
    off, before = (
        np.linalg.norm(poses[-20:, :3, 3] - true[-20:, :3, 3], axis=1).mean() for poses in (corrected, given)
    )
    assert off < 0.2 * before


def test_a_map_of_late_poses_is_replaced_as_soon_as_that_is_known() -> None:
    estimates, true, given = followed(LATE)
    known = next(i for i, estimate in enumerate(estimates) if estimate.delay_s > 0.9 * LATE / RATE)
    assert known <= 25
    corrected = np.array([estimate.T_world_camera for estimate in estimates])
    off, before = (np.linalg.norm(poses[:, :3, 3] - true[:, :3, 3], axis=1) for poses in (corrected, given))
    assert off[known : known + 10].max() < 0.01 < before[known : known + 10].min()
    moves = [np.linalg.norm(estimates[i].T_world_map[:3, 3]) for i in (known - 1, known)]  # type: ignore[index]
    assert moves[1] > moves[0] + 0.003


def test_late_poses_bend_no_depth_before_that_is_known() -> None:
    estimates, _, _ = followed(LATE)
    unknown = [estimate for estimate in estimates if estimate.delay_s == 0]
    assert len(unknown) > 10
    assert not any(estimate.calibration.bend for estimate in unknown)


def test_what_was_seen_before_the_delay_was_known_is_mended_as_well() -> None:
    estimates, _, _ = followed(LATE)
    assert estimates[-1].delay_s > 0.02
    told = [estimate.corrections for estimate in estimates if estimate.corrections is not None]
    assert told[-1].stamps_ns[0] == told[0].stamps_ns[0]
    assert len(told[-1].stamps_ns) > len(told[0].stamps_ns)


@pytest.mark.parametrize(("metres", "most_s"), [(0.0, 0.0), (0.01, 0.006), (0.02, 0.006)])
def test_poses_that_are_in_time_stay_so(metres: float, most_s: float) -> None:
    estimates, _, _ = followed(0, metres)
    assert max(abs(estimate.delay_s) for estimate in estimates) <= most_s


@pytest.mark.parametrize("jump", [0.2, 1.0])
def test_poses_that_jump_are_as_late_as_before(jump: float) -> None:
    estimates, _, given = followed(LATE, jump=jump)
    after = 2 * len(given) // 3
    known_s = estimates[after - 1].delay_s
    assert known_s == pytest.approx(LATE / RATE, rel=0.1)
    assert estimates[-1].delay_s == pytest.approx(known_s, abs=0.005)
    corrected = np.array([estimate.T_world_camera for estimate in estimates])
    off = np.linalg.norm(corrected[after:, :3, 3] - given[after:, :3, 3], axis=1)
    # A jump that a camera could make looks like its velocity, for one frame.
    assert off[0] <= 1.1 * jump
    # And a pose that was not carried on does not say so.
    assert (estimates[after].delay_s == 0) == (jump > 0.5)
    assert off[1:].max() < 0.05


def test_poses_are_taken_as_they_are_where_they_are_told_to_be_in_time() -> None:
    estimates, _, _ = followed(LATE, sigma=0.0)
    assert {estimate.delay_s for estimate in estimates} == {0.0}


def room() -> Surface:
    """Three walls that meet in a corner, in the world."""
    a, b = (side.ravel() for side in np.meshgrid(np.arange(-1.0, 1.0, 0.05), np.arange(-1.0, 1.0, 0.05)))
    # In the middle of a voxel: as far as to its sides, a surface finds itself again.
    still = np.full_like(a, 1.05)
    walls = [(np.stack((still, a, b), 1), (-1, 0, 0)), (np.stack((a, still, b), 1), (0, -1, 0))]
    walls.append((np.stack((a, b, still), 1), (0, 0, -1)))
    points = np.concatenate([wall for wall, _ in walls])
    normals = np.concatenate([np.tile(normal, (len(wall), 1)) for wall, normal in walls])
    return Surface(points.astype(np.float32), normals.astype(np.float32), np.full(len(points), 0.002, np.float32))


ROOM = room()


def swung(time_s: float) -> NDArray[np.float64]:
    """Pose (4, 4) of a camera that swings from side to side."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(np.array([0.0, 0.2 * np.sin(2 * time_s), 0.0]))
    pose[:3, 3] = 0.3 * np.sin(3 * time_s), 0.1 * np.cos(2 * time_s), -0.5
    return pose


def seen(T_world_camera: NDArray[np.float64]) -> Surface:
    """The room as the camera sees it."""
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    points, normals = (ROOM.points - t) @ R, ROOM.normals @ R
    return Surface(points.astype(np.float32), normals.astype(np.float32), ROOM.sigma)


def swinging(lag_s: float, step_s: float, noise: float = 0.0, count: int = 120) -> PoseDelay:
    """What is known of a camera that swings, by poses of `lag_s` ago that are off by so many metres."""
    rng, delay = np.random.default_rng(0), PoseDelay(PoseSettings().given_delay_sigma)
    for index in range(count):
        given = swung(step_s * index - lag_s)
        given[:3, 3] += noise * rng.normal(size=3)
        delay.compensated(index * round(1e9 * step_s), given, seen(swung(step_s * index)))
    return delay


@pytest.mark.parametrize("lag_s", [-0.05, 0.02, 0.08])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_the_delay_of_a_camera_that_swings_is_found(lag_s: float, noise: float) -> None:
    assert swinging(lag_s, 1 / 15, noise).delay_s == pytest.approx(lag_s, rel=0.1, abs=0.004)


def test_the_delay_is_found_within_two_seconds() -> None:
    assert swinging(0.067, 1 / 30, count=60).delay_s == pytest.approx(0.067, abs=0.01)


def test_poses_far_apart_tell_no_velocity() -> None:
    assert swinging(0.08, 0.5).delay_s == 0


def test_poses_in_time_that_tremble_stay_so() -> None:
    assert swinging(0.0, 1 / 15, noise=0.02).delay_s == 0


def test_a_tracker_mounted_otherwise_than_told_is_not_late() -> None:
    delay, mounted = PoseDelay(PoseSettings().given_delay_sigma), np.eye(4)
    mounted[:3, :3], mounted[:3, 3] = rotation_from_vector(np.array([0.01, 0.01, -0.01])), (0.01, -0.01, 0.015)
    for index in range(120):
        pose = swung(index / 15)
        delay.compensated(index * 66_666_667, pose @ mounted, seen(pose))
        assert abs(delay.delay_s) < 0.004


def test_stamps_that_go_back_are_no_time_that_passes() -> None:
    delay = swinging(0.08, 1 / 15, count=45)
    known, place = delay.delay_s, swung(0.0)
    for _ in range(4):
        np.testing.assert_array_equal(delay.compensated(0, place, seen(place)), place)
    assert delay.delay_s == known
    for index in range(480):
        delay.compensated(round(1e9 / 15 * index), swung(index / 15), seen(swung(index / 15)))
    assert delay.delay_s < known - 0.01


def test_a_jump_tells_no_velocity() -> None:
    delay = swinging(0.08, 1 / 15)
    delay.interrupt()
    place = swung(8.1)
    np.testing.assert_array_equal(delay.compensated(8_066_666_667, place, seen(place)), place)


def test_frames_that_see_too_little_tell_nothing() -> None:
    delay = PoseDelay(PoseSettings().given_delay_sigma)
    nothing = Surface(*(array[:3] for array in ROOM))
    for index in range(60):
        delay.compensated(index * 66_666_667, swung(index / 15), nothing)
    assert delay.delay_s == 0


def test_what_is_said() -> None:
    assert notice(0.004) == ""
    assert "33 ms older than their images" in notice(0.033)
    assert "33 ms newer than their images" in notice(-0.033)
