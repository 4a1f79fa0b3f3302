"""A tracker that is lost, or started again, finds itself in the map that is there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spot3d.dataflow.snapshot_file import SnapshotError, snapshot_bytes, write_snapshot
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.features import Features
from spot3d.pose.landmark_map import LANDMARK
from spot3d.pose.providers import make_tracker
from spot3d.pose.relocalisation import relocalised
from spot3d.pose.settings import PoseSettings
from spot3d.pose.snapshot import read_tracker, tracker_snapshot
from spot3d.pose.tracking import MapTracker
from spot3d.source.scene.scene import Scene
from spot3d.trajectory import rotation_from_vector

SCENE = Scene(0, frames=300)


def track(tracker: MapTracker, index: int) -> PoseEstimate:
    frame = SCENE[index]
    given = frame.T_world_camera if index == 0 else None
    return tracker.track(replace(frame, T_world_camera=given))


def off(estimate: PoseEstimate, index: int) -> float:
    true = SCENE.true_pose(index)
    assert true is not None
    return float(np.linalg.norm(estimate.T_world_camera[:3, 3] - true[:3, 3]))


def started(provider: str) -> MapTracker:
    tracker = make_tracker(PoseSettings.model_validate({"provider": provider}))
    assert isinstance(tracker, MapTracker)
    return tracker


@pytest.mark.parametrize("provider", ["kiss", "gicp"])
def test_a_tracker_that_is_started_again_is_in_the_same_world(provider: str, tmp_path: Path) -> None:
    if provider == "gicp":
        pytest.importorskip("small_gicp")
    tracker, file = started(provider), tmp_path / "pose.snapshot"
    for index in range(0, 40, 2):
        assert track(tracker, index).status == "ok"
    state = tracker.state()
    assert state is not None
    write_snapshot(file, snapshot_bytes(tracker_snapshot(state, "a", "its world")))
    assert read_tracker(file, "another stream") is None
    read = read_tracker(file, "a")
    assert read is not None
    again = started(provider)
    again.resume(read[0])
    assert read[1] == "its world"
    for index in (60, 62):
        estimate = track(again, index)
        assert estimate.status == "ok"
        assert off(estimate, index) < 0.02
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(SnapshotError, match="damaged"):
        read_tracker(file, "a")


def features_at(T: np.ndarray, places: np.ndarray, descriptors: np.ndarray, wrong: float) -> Features:
    """What a camera sees of landmarks, a centimetre off, a share of them with another's descriptor."""
    rng = np.random.default_rng(1)
    points = (places - T[:3, 3]) @ T[:3, :3] + rng.normal(0, 0.01, places.shape)
    told = descriptors.copy()
    told[rng.random(len(told)) < wrong] = descriptors[0]
    return Features(np.zeros((len(points), 2)), points, told, np.ones(len(points)))


@pytest.mark.parametrize(("wrong", "found"), [(0.0, True), (0.6, True), (1.0, False)])
def test_landmarks_tell_the_place_from_anywhere(wrong: float, found: bool) -> None:
    rng = np.random.default_rng(0)
    landmarks = np.zeros(3000, LANDMARK)
    landmarks["position"], landmarks["sightings"] = rng.uniform(-3, 3, (3000, 3)), 2
    landmarks["descriptor"] = rng.integers(0, 2**64, (3000, 4), np.uint64)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_from_vector(np.array([0.5, 2.0, -0.3])), (1.0, -2.0, 0.5)
    seen = features_at(T, landmarks["position"][:120], landmarks["descriptor"][:120], wrong)
    place = relocalised(seen, landmarks)
    assert (place is not None) == found
    if place is not None:
        assert place.agreeing > 30
        np.testing.assert_allclose(place.T_world_camera, T, atol=0.02)


@pytest.mark.parametrize(("last", "found"), [(7, True), (6, False)])
def test_of_landmarks_seen_once_those_of_the_last_frame_count(last: int, found: bool) -> None:
    rng = np.random.default_rng(0)
    landmarks = np.zeros(300, LANDMARK)
    landmarks["position"], landmarks["sightings"] = rng.uniform(-3, 3, (300, 3)), 1
    landmarks["descriptor"] = rng.integers(0, 2**64, (300, 4), np.uint64)
    landmarks["last"] = np.where(np.arange(300) < 120, last, 7 - np.arange(300) % 2)
    seen = features_at(np.eye(4), landmarks["position"][:120], landmarks["descriptor"][:120], 0.2)
    assert (relocalised(seen, landmarks) is not None) == found


def test_few_landmarks_tell_nothing() -> None:
    seen = Features(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros((0, 4), np.uint64), np.zeros(0))
    assert relocalised(seen, np.zeros(0, LANDMARK)) is None
    assert relocalised(seen, np.zeros(100, LANDMARK)) is None
