"""Odometry learns what bends the depth of its camera, and says where its keyframes were."""

from functools import cache

import numpy as np
import pytest
from fusion_room import look_at
from numpy.typing import NDArray
from test_pose_correction import CAMERA
from test_pose_tracking import LARGER, TABLE, render

from made_frame import frame_of
from spot3d.calibration import NOMINAL, bend_of_image
from spot3d.evaluate.faults import bent
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.keyframe_adjuster import Adjusted
from spot3d.pose.motion import moved, turned
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.pose.tracking import MapTracker
from spot3d.source.scene.scene import Scene

BEND = 0.006
FRAMES, EVERY = 600, 6
FIELD = bent(np.ones(CAMERA.shape, np.float32), BEND, 1)


@cache
def scene() -> list[NDArray[np.float32]]:
    made = Scene(0, frames=FRAMES, intrinsics=CAMERA)
    return [made[frame].depth_metres() for frame in range(0, FRAMES, EVERY)]


def followed(settings: PoseSettings, field: NDArray[np.float32] | float) -> tuple[MapTracker, list[PoseEstimate]]:
    """Odometry by depth alone, in the first camera's world."""
    tracker = make_tracker(settings)
    assert isinstance(tracker, MapTracker)
    stamps = (1 + frame * EVERY * 100_000_000 // 3 for frame in range(FRAMES // EVERY))
    return tracker, [
        tracker.track(frame_of(stamp, (depth * field).astype(np.float32), CAMERA))
        for stamp, depth in zip(stamps, scene(), strict=True)
    ]


def left(estimate: PoseEstimate, field: NDArray[np.float32] | float) -> float:
    """Deviation of what is left of the bend, as a share."""
    bend = estimate.calibration.bend
    return float(np.std(field * np.exp(bend_of_image(np.array(bend), CAMERA.shape)) if bend else field))


def test_what_bends_depth_is_found_by_the_way() -> None:
    tracker, estimates = followed(PoseSettings(), FIELD)
    assert {estimate.status for estimate in estimates} == {"ok"}
    assert left(estimates[-1], FIELD) < 0.75 * float(FIELD.std())
    state = tracker.state()
    assert state is not None
    assert state.bend == estimates[-1].calibration.bend


def test_straight_depth_stays_as_it_is() -> None:
    _, estimates = followed(PoseSettings(), 1.0)
    assert max(left(estimate, 1.0) for estimate in estimates) < 0.001


def test_where_nothing_is_asked_depth_is_taken_as_it_is() -> None:
    _, estimates = followed(PoseSettings(depth_bend_sigma=0.0), FIELD)
    assert all(estimate.calibration == NOMINAL for estimate in estimates)
    assert all(estimate.corrections is None for estimate in estimates)


def test_a_tracker_that_is_started_again_knows_the_bend_at_once() -> None:
    tracker, estimates = followed(PoseSettings(), FIELD)
    state = tracker.state()
    assert state is not None
    again = make_tracker(PoseSettings())
    assert isinstance(again, MapTracker)
    again.resume(state)
    before = left(estimates[-1], FIELD)
    stamp = 1 + FRAMES * 100_000_000 // 3
    for depth in scene()[-1:-20:-1]:
        estimate = again.track(frame_of(stamp, depth * FIELD, CAMERA))
        assert estimate.status == "ok"
        assert left(estimate, FIELD) < before + 0.001
        stamp += 200_000_000


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_corrections_of_odometry_leave_the_last_keyframe_where_it_is(turn: float) -> None:
    """The world of the adjusted keyframes may lie elsewhere, and be turned."""
    rng = np.random.default_rng(0)
    before = [moved(np.eye(4), 0.1 * rng.normal(size=6)) for _ in range(3)]
    twists = [0.01 * rng.normal(size=6) for _ in range(2)] + [np.zeros(6)]
    world = turned(moved(np.eye(4), np.array((1.0, 2.0, 3.0, 0.0, 0.0, 0.0))), np.array((0.0, 0.0, turn)))
    now = [world @ moved(pose, twist) for pose, twist in zip(before, twists, strict=True)]
    told = Adjusted([1, 2, 3], before, now).where_the_last_is()
    np.testing.assert_allclose(told.twists, twists, atol=1e-9)


def test_a_camera_that_stands_still_learns_no_bend() -> None:
    """However long it sees the same again: for two minutes."""
    place, tracker = look_at(np.array([0, -0.75, 1.45]), np.array([0.1, 0.1, 0.7])), make_tracker(PoseSettings())
    for second in range(120):
        depth = render(place, second, TABLE, LARGER)
        estimate = tracker.track(frame_of(1 + second * 10**9, depth, LARGER))
        assert estimate.status == "ok"
    bend = estimate.calibration.bend
    assert np.abs(bend_of_image(np.array(bend), LARGER.shape)).max(initial=0.0) < 0.002 if bend else True
