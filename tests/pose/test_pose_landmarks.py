"""Features with depth, the map of landmarks, and the drift that they correct."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from made_frame import frame_of
from spot3d.camera import Intrinsics, invert
from spot3d.depth_noise import KINECT_V1
from spot3d.pose.drift import Agreement, DriftCorrection
from spot3d.pose.features import FeatureDetector, Features
from spot3d.pose.landmark_map import LandmarkMap
from spot3d.pose.motion import moved
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.source.scene.scene import Scene
from spot3d.trajectory import rotation_angle, rotation_from_vector

CAMERA = Intrinsics(525.0, 525.0, 319.5, 239.5, 640, 480)
# What a depth camera knows of its pose in front of a wall: much along its axis, little sideways (1/m2, 1/rad2).
INFORMATION = np.diag([1e4, 1e4, 1e7, 1e7, 1e7, 1e4])
FRAME_S = 1 / 30


def world(count: int = 3000) -> tuple[NDArray[np.float64], NDArray[np.uint64]]:
    """Points on a wavy wall 2 m ahead, 4 m wide, and a descriptor for each."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-2, 2, count), rng.uniform(-1, 1, count)
    points = np.stack((x, y, 2 + 0.2 * np.sin(3 * x)), axis=1)
    return points, rng.integers(0, 2**64, (count, 4), np.uint64)


def seen(T_world_camera: NDArray[np.float64], seed: int = 0, noise: float = 0.5, wrong: float = 0.0) -> Features:
    """The wall's features in view of a pose, `noise` pixels off; a share `wrong` lies anywhere near."""
    places, descriptors = world()
    rng = np.random.default_rng(seed)
    T = invert(T_world_camera)
    x, y, z = (places @ T[:3, :3].T + T[:3, 3]).T
    pixels = np.stack((CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy), axis=1)
    inside = (z > 0) & (pixels > 0).all(axis=1) & (pixels < (CAMERA.width, CAMERA.height)).all(axis=1)
    pixels, z, descriptors = pixels[inside], z[inside], descriptors[inside]
    pixels = pixels + rng.normal(0, noise, pixels.shape)
    pixels[rng.random(len(pixels)) < wrong] += rng.uniform(10, 20, 2)
    pixels = np.clip(pixels, 0, (CAMERA.width - 1, CAMERA.height - 1))
    rays = np.column_stack(((pixels - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy), np.ones(len(z))))
    return Features(pixels, rays * z[:, None], descriptors, np.ones(len(z)))


def pose(x: float, turn: float = 0.0) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3] = rotation_from_vector(np.array([0.0, turn, 0.0]))
    T[0, 3] = x
    return T


def none_of(features: Features) -> NDArray[np.bool_]:
    return np.zeros(len(features), np.bool_)


def test_features_lie_where_the_depth_says_and_never_at_an_edge() -> None:
    frame = Scene(0, frames=1)[0]
    depth = frame.depth_metres()
    depth[:, 300:340] = 0
    features = FeatureDetector(500, 4.0).detect(frame.colour, depth, CAMERA)
    assert 100 < len(features) <= 500
    u, v = np.rint(features.pixels).astype(int).T
    at_hole = (u > 296) & (u < 343)
    assert not at_hole.any()
    for du, dv in ((0, 0), (3, 0), (-3, 0), (0, 3), (0, -3)):
        assert np.abs(depth[v + dv, u + du] - features.points[:, 2]).max() < 2 * (0.01 + 0.01 * 4**2)
    projected = features.points[:, :2] / features.points[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)
    np.testing.assert_allclose(projected, features.pixels, atol=1e-9)


def test_a_blank_image_has_no_features() -> None:
    blank, depth = np.full((480, 640, 3), 90, np.uint8), np.ones(CAMERA.shape, np.float32)
    assert len(FeatureDetector(500, 4.0).detect(blank, depth, CAMERA)) == 0


def test_landmarks_are_known_again_from_elsewhere() -> None:
    landmarks = LandmarkMap(5000)
    first = seen(pose(0))
    landmarks.insert(first, landmarks.match(first, CAMERA, pose(0)), none_of(first), pose(0))
    again = seen(pose(0.1, 0.05), seed=1)
    # The pose is expected 2 cm beside where it is.
    matches = landmarks.match(again, CAMERA, pose(0.12, 0.05))
    matched = matches.landmark >= 0
    same = (landmarks.rows["descriptor"][matches.landmark[matched]] == again.descriptors[matched]).all(axis=1)
    assert same.all()
    assert matched.sum() > 0.7 * len(again)
    assert len(np.unique(matches.landmark[matched])) == matched.sum()


def test_a_landmark_out_of_reach_is_not_known() -> None:
    landmarks = LandmarkMap(5000)
    first = seen(pose(0))
    landmarks.insert(first, landmarks.match(first, CAMERA, pose(0)), none_of(first), pose(0))
    assert (landmarks.match(seen(pose(0)), CAMERA, pose(0.5)).landmark < 0).mean() > 0.95


def test_a_landmark_settles_at_the_mean_of_its_first_sightings() -> None:
    landmarks = LandmarkMap(5000)
    for index in range(12):
        features = seen(pose(0), seed=index, noise=1.0)
        matches = landmarks.match(features, CAMERA, pose(0))
        before = landmarks.rows["position"].copy()
        landmarks.insert(features, matches, matches.landmark >= 0, pose(0))
    known = matches.landmark[matches.landmark >= 0]
    np.testing.assert_array_equal(landmarks.rows["position"][known], before[known])
    places, descriptors = world()
    order = {tuple(descriptor): place for descriptor, place in zip(descriptors.tolist(), places, strict=True)}
    true = np.array([order[tuple(row)] for row in landmarks.rows["descriptor"][known].tolist()])
    error = landmarks.rows["position"][known] - true
    single = seen(pose(0), seed=0, noise=1.0)
    true = np.array([order[tuple(row)] for row in single.descriptors.tolist()])
    assert error.std() < 0.7 * (single.points - true).std()


def test_chance_corners_go_and_the_map_is_bounded() -> None:
    landmarks = LandmarkMap(3000)
    rng = np.random.default_rng(0)
    lasting = seen(pose(0))
    for index in range(60):
        chance = Features(
            rng.uniform(20, 460, (300, 2)),
            np.column_stack((rng.uniform(-0.5, 0.5, (300, 2)), np.full(300, 2.0))),
            rng.integers(0, 2**64, (300, 4), np.uint64),
            np.ones(300),
        )
        features = lasting if index % 2 else chance
        matches = landmarks.match(features, CAMERA, pose(0))
        landmarks.insert(features, matches, matches.landmark >= 0, pose(0))
        assert len(landmarks.rows) <= 3000
    kept = {tuple(row) for row in landmarks.rows["descriptor"].tolist()}
    assert np.mean([tuple(row) in kept for row in lasting.descriptors.tolist()]) > 0.9


def test_of_too_many_good_landmarks_it_tells_how_many_it_forgot() -> None:
    landmarks, features = LandmarkMap(1000), seen(pose(0))
    rooms = [pose(0), pose(0)]
    rooms[1][:3, 3] += 100.0
    for place in (*rooms, *rooms):
        matches = landmarks.match(features, CAMERA, place)
        landmarks.insert(features, matches, matches.landmark >= 0, place)
    assert landmarks.forgotten > 0
    assert len(landmarks.rows) <= 1000


@pytest.mark.parametrize("wrong", [0.0, 0.3])
def test_landmarks_stop_the_drift_of_a_sideways_sweep(wrong: float) -> None:
    """A registration that loses 5 % of each step to the side: what a depth camera's distortion does."""
    corrected = DriftCorrection(PoseSettings())
    registered = estimate = pose(0)
    for index in range(100):
        true = pose(0.01 * index, 0.002 * index)
        step = invert(pose(0.01 * (index - 1), 0.002 * (index - 1))) @ true if index else np.eye(4)
        step[0, 3] *= 0.95
        registered = registered @ step
        features = seen(true, seed=index, wrong=wrong)
        estimate = corrected.correct(features, CAMERA, estimate @ step, INFORMATION, FRAME_S if index else 0.0)
    drift = np.linalg.norm(registered[:3, 3] - true[:3, 3])
    left = np.linalg.norm(estimate[:3, 3] - true[:3, 3])
    assert drift > 0.04
    assert left < 0.3 * drift
    assert rotation_angle(estimate[:3, :3].T @ true[:3, :3]) < np.radians(0.3)


def test_a_registration_good_to_a_part_of_a_pixel_is_left_alone() -> None:
    drift = DriftCorrection(PoseSettings())
    for index in range(30):
        T = pose(0.01 * index)
        off = drift.correct(seen(T, seed=index), CAMERA, T, INFORMATION, FRAME_S)[:3, 3] - T[:3, 3]
        assert np.linalg.norm(off) < 2e-4


def gradient(
    T: NDArray[np.float64], points: NDArray[np.float64], landmarks: NDArray[np.float64], blur: NDArray[np.float64]
) -> NDArray[np.float64]:
    """J^T M r of points with errors across and along their rays, weighted by Geman-McClure, one by one."""
    total = np.zeros(6)
    for point, landmark, b in zip(points, landmarks, blur, strict=True):
        lever = T[:3, :3] @ point
        r, ray = lever + T[:3, 3] - landmark, lever / np.linalg.norm(lever)
        skew = np.array([[0, -lever[2], lever[1]], [lever[2], 0, -lever[0]], [-lever[1], lever[0], 0]])
        wide, deep = (525 / (b * point[2])) ** 2, 1 / (KINECT_V1.sigma(point[2]) + 0.002) ** 2
        M = wide * np.eye(3) + (deep - wide) * np.outer(ray, ray)
        across, along = np.linalg.norm(r - (r @ ray) * ray), r @ ray
        weight = 1 / (1 + (across**2 * wide / 2 + along**2 * deep) / 4) ** 2
        total += weight * np.hstack((np.eye(3), -skew)).T @ M @ r
    return total


@pytest.mark.parametrize("sure", [0.0, 1e6])
def test_the_twist_ends_where_the_plain_gradient_vanishes(sure: float) -> None:
    """Also with something that is expected; how sure that is: 1/m2 and 1/rad2."""
    rng = np.random.default_rng(5)
    T = moved(pose(0.3, 0.2), np.full(6, 0.01))
    points = rng.uniform((-1, -1, 1), (1, 1, 3), (40, 3))
    places = points @ T[:3, :3].T + T[:3, 3] + rng.normal(0, 0.003, (40, 3)) + (0.004, -0.003, 0.002)
    blur = rng.uniform(1, 2, 40)
    expected = np.full(6, 0.003)
    lateral, axial = blur / 525 * points[:, 2], KINECT_V1.sigma(points[:, 2]) + 0.002
    twist = Agreement(points, places, lateral, axial, 1 / 525).twist(T, sure * np.eye(6), expected)
    left = gradient(moved(T, twist), points, places, blur) + sure * (twist - expected)
    assert np.linalg.norm(twist) > 2e-3
    assert np.linalg.norm(left) < 0.02 * np.linalg.norm(gradient(T, points, places, blur) - sure * expected)


def test_a_few_landmarks_do_not_move_the_pose() -> None:
    drift = DriftCorrection(PoseSettings())
    all_seen = seen(pose(0))
    few = Features(all_seen.pixels[:10], all_seen.points[:10], all_seen.descriptors[:10], all_seen.blur[:10])
    drift.correct(few, CAMERA, pose(0), INFORMATION, 0.0)
    np.testing.assert_array_equal(drift.correct(few, CAMERA, pose(0.01), INFORMATION, FRAME_S), pose(0.01))


def test_mistaken_landmarks_do_not_move_the_pose_far() -> None:
    """All landmarks agree on a place half a metre away: no drift is that large between two frames."""
    drift = DriftCorrection(PoseSettings())
    drift.correct(seen(pose(0)), CAMERA, pose(0), INFORMATION, 0.0)
    T = moved(pose(0), np.array([0, 0, 0.35, 0, 0, 0.0]))
    assert np.linalg.norm(drift.correct(seen(pose(0)), CAMERA, T, INFORMATION, FRAME_S)[:3, 3] - T[:3, 3]) < 0.1


def test_the_tracker_uses_colour_where_there_is_some() -> None:
    """With it, it goes elsewhere than by depth alone, and stays as near to the truth."""
    scene = Scene(0, frames=40)
    trackers = [make_tracker(PoseSettings()), make_tracker(PoseSettings())]
    for frame in scene:
        depth, given = frame.depth_metres(), frame.T_world_camera
        estimates = [
            tracker.track(frame_of(frame.stamp_ns, depth, frame.intrinsics, given, colour)).T_world_camera
            for tracker, colour in zip(trackers, (frame.colour, None), strict=True)
        ]
    assert (estimates[0] != estimates[1]).any()
    assert given is not None
    assert np.linalg.norm(estimates[0][:3, 3] - given[:3, 3]) < 0.003


def test_landmarks_agree_with_a_pose_that_is_true_alone() -> None:
    drift = DriftCorrection(PoseSettings())
    drift.correct(seen(pose(0)), CAMERA, pose(0), INFORMATION, 0.0)
    features = seen(pose(0.3), seed=1, wrong=0.5)
    assert np.count_nonzero(drift.seen_again(features, CAMERA, pose(0.3))) > 0.3 * len(features)
    assert np.count_nonzero(drift.seen_again(features, CAMERA, pose(0.7))) < 5


@pytest.mark.parametrize(("sure", "along"), [(np.diag([0, 0, 1e12, 0, 0, 0]), 0.05), (np.zeros((6, 6)), 0.0)])
def test_a_pose_is_completed_by_landmarks_where_depth_does_not_hold_it(sure: NDArray[np.float64], along: float) -> None:
    """Depth, if it knows, has the camera 5 cm further ahead; of all else the landmarks have the say."""
    drift = DriftCorrection(PoseSettings())
    for index in range(4):
        drift.correct(seen(pose(0), seed=index), CAMERA, pose(0), INFORMATION, FRAME_S)
    registered = pose(0.03)
    registered[2, 3] = 0.05
    completed = drift.completed(seen(pose(0), seed=9), CAMERA, pose(0.01), registered, sure)
    assert abs(completed[2, 3] - along) < 0.005
    assert abs(completed[0, 3]) < 0.005


def test_frames_between_two_comparisons_keep_the_correction() -> None:
    drift = DriftCorrection(PoseSettings())
    for index in range(6):
        drift.correct(seen(pose(0), seed=index), CAMERA, pose(0), INFORMATION, FRAME_S)
    corrected = drift.correct(seen(pose(0), seed=9), CAMERA, pose(0.01), INFORMATION, FRAME_S)
    assert abs(corrected[0, 3] - 0.01) > 2e-3
    np.testing.assert_array_equal(drift.held(pose(0.01)), corrected)


@pytest.mark.parametrize(("interval", "every", "compared"), [(0.0, 1, 12), (0.05, 1, 6), (0.05, 2, 6), (0.2, 1, 2)])
def test_landmarks_are_looked_for_at_intervals_of_time(
    monkeypatch: pytest.MonkeyPatch, interval: float, every: int, compared: int
) -> None:
    seen_at: list[int] = []
    detect = FeatureDetector.detect

    def counted(*arguments: Any) -> Features:
        seen_at.append(1)
        return detect(*arguments)

    monkeypatch.setattr(FeatureDetector, "detect", counted)
    scene = Scene(0, frames=12)
    tracker = make_tracker(PoseSettings(landmark_interval=interval))
    for index in range(0, 12, every):
        frame = scene[index]
        estimate = tracker.track(replace(frame, T_world_camera=None))
        assert estimate.status == "ok"
    assert len(seen_at) == compared
