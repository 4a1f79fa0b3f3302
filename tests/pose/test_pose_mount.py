"""A camera that is turned against what the given poses are of."""

import numpy as np
import pytest
from test_pose_correction import CAMERA, FRAME_NS, recording, shaken, tracked

from spot3d.pose.mount import MountTurn, told
from spot3d.pose.providers import make_tracker
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


def way(seed: int, vector: np.ndarray, metres: float = 0.0, sigma: float = 0.014) -> tuple[np.ndarray, np.ndarray]:
    """The last turn that is found on ten seconds around the built-in scene, and the smearing (n,) of the poses after.

    Smearing: radians by which the last poses are turned against true ones, but for what is alike for all of them.
    """
    frames = range(0, 600, 6)
    scene = Scene(seed, frames=600, intrinsics=CAMERA)
    tracker = make_tracker(GIVEN.model_copy(update={"mount_turn_sigma": sigma}))
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
    return estimates[-1].turn, rotation_angle(off @ (u @ vt).T)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_camera_that_is_turned_smears_half_as_much_at_most(seed: int) -> None:
    found, left = way(seed, TURN)
    nothing, before = way(seed, TURN, sigma=0.0)
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
    assert np.degrees(np.linalg.norm(last.turn)) < 0.3


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
    assert H.shape == (10, 10)
    before = g[7:] @ np.linalg.pinv(H[7:, 7:]) @ g[7:]
    along = H[7:, 7:] @ small
    assert g[7:] @ along / (along @ along) == pytest.approx(1, abs=0.25)
    planes.turn(small)
    H, g, _ = planes.normal_equations(seen[1], true[second], 0.05, 4.5, as_given=True)
    assert g[7:] @ np.linalg.pinv(H[7:, 7:]) @ g[7:] < 0.1 * before


def test_chance_turns_nothing() -> None:
    """What lies within two standard deviations of none may be chance; what is sure is found."""
    mount, pose_information = MountTurn(0.014), 1e8 * np.eye(6)
    H = np.diag([*np.full(7, 1e3), *np.full(3, 4e3)])
    assert not mount.learn(H, np.append(np.zeros(7), 4e3 * TURN), pose_information, np.zeros(6), 0.1).any()
    for _ in range(300):
        left = TURN - mount.vector
        mount.learn(H, np.append(np.zeros(7), 4e3 * left), pose_information, np.zeros(6), 1.0)
    np.testing.assert_allclose(mount.vector, TURN, atol=0.004)


def test_a_turn_is_told_in_degrees_about_the_cameras_axes() -> None:
    assert told(np.radians((0.2, 0.3, 0.0))) == ""
    assert "turned by 1.7 deg against the given poses (1.5, -0.5, 0.5 about its x, y, z)" in told(TURN)
