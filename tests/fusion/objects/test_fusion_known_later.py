"""Keyframes are seen anew by what is known later: of the camera, and of the poses that they had."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import look_at, orbit, standing
from voting_room import SETTINGS, agreed, assert_found, assert_same, keyframe, keyframes, overlaps

from spot3d.calibration import NOMINAL, Calibration, moved_planes, sheared
from spot3d.found_object import FoundObjects
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_from_vector


def wrong_by(factor: float) -> list[Keyframe]:
    """Keyframes of which the first half was seen with depth that is so many times too large, which is known later."""
    frames = keyframes()
    for row in range(6):
        depth = frames[row].depth * np.float32(factor)
        frames[row] = replace(frames[row], depth=depth, planes=frames[row].planes * (1, 1, 1, factor))
    known = Calibration(1 / factor)
    return [replace(frame, calibration=NOMINAL if row < 6 else known) for row, frame in enumerate(frames)]


def assert_better(found: FoundObjects, unaware: FoundObjects, by: float, off: float) -> None:
    """Boxes fit by so much better than where nothing was known, and nearly as well as if it had been known at once."""
    assert_found(found)
    fit, before, exact = (overlaps(one.objects).max(axis=1).mean() for one in (found, unaware, agreed(keyframes())))
    assert fit > exact - off
    assert fit > before + by


@pytest.mark.parametrize("factor", [0.96, 1.04])
def test_keyframes_of_before_the_scale_of_depth_was_known(factor: float) -> None:
    votes, frames = ViewConsensus(SETTINGS), wrong_by(factor)
    votes.update(frames[:6])
    found = votes.update(frames[6:], Calibration(1 / factor))
    assert_better(found, agreed([replace(frame, calibration=NOMINAL) for frame in frames]), 0.1, 0.03)


@pytest.mark.parametrize("known", [Calibration(turn=(0.03, -0.01, 0.02)), Calibration(centre=(0.02, -0.04))])
def test_keyframes_of_before_it_was_known_where_the_camera_looks(known: Calibration) -> None:
    frames, back = keyframes(), np.eye(4)
    back[:3, :3] = rotation_from_vector(np.array(known.turn)).T
    wrong = (-known.centre[0], -known.centre[1])
    told = Calibration(centre=wrong).camera(frames[0].camera)
    for row, frame in enumerate(frames):
        if row < 6:
            planes = moved_planes(frame.planes, sheared(wrong), np.zeros(3))
            frames[row] = replace(frame, T_map_camera=frame.T_map_camera @ back, camera=told, planes=planes)
        else:
            frames[row] = replace(frame, calibration=known)
    votes = ViewConsensus(SETTINGS)
    votes.update(frames[:6])
    found = votes.update(frames[6:], known)
    assert_better(found, agreed([replace(frame, calibration=NOMINAL) for frame in frames]), 0.1, 0.03)


STEP_NS = 1_700_000_000_000_000_000 // 12


def displaced(seed: int = 0) -> tuple[list[Keyframe], PoseCorrections]:
    """Keyframes that were posed 2 cm and 1 deg off, each otherwise, and what is known of that in the end."""
    off = np.repeat((0.02, np.radians(1.0)), 3) * np.random.default_rng(seed).normal(size=(12, 6))
    frames, twists = keyframes(), []
    for row, (frame, wrong) in enumerate(zip(frames, off, strict=True)):
        pose = frame.T_map_camera.copy()
        pose[:3, :3] = rotation_from_vector(wrong[3:]) @ pose[:3, :3]
        pose[:3, 3] += wrong[:3]
        frames[row] = replace(frame, T_map_camera=pose, stamp_ns=row * STEP_NS)
        twists.append(-wrong)
    return frames, PoseCorrections(STEP_NS * np.arange(12), np.array(twists))


def test_poses_that_are_known_better_later() -> None:
    """As good as if they had been known at once, whatever was found by then."""
    frames, known = displaced()
    votes = ViewConsensus(SETTINGS)
    votes.update(frames[:6])
    unaware = votes.update(frames[6:])
    found = votes.update([], corrections=known)
    assert_better(found, unaware, 0.05, 0.02)


def test_keyframes_from_before_the_corrections_stay() -> None:
    frames, known = displaced()
    votes, late = ViewConsensus(SETTINGS), PoseCorrections(known.stamps_ns[8:], known.twists[8:])
    votes.update(frames)
    votes.update([], corrections=late)
    for number, frame in enumerate(frames):
        place = np.linalg.inv(frame.T_map_camera)[:3]
        assert np.allclose(votes._graph.views[number].pose, place, atol=1e-4) == (number < 8)


def test_a_keyframe_that_moves_away_takes_nothing_along() -> None:
    """It was all that its view had to do with the object: nobody is asked anew about the others' segments."""
    thing = (standing(0.0, 0.0, (0.16, 0.12, 0.14), 0.2),)
    poses = [*orbit(6), look_at((0.45, -0.8, 0.6), (0.57, 0.1, 0.05))]  # the last one sees a piece, at its border
    frames = [replace(keyframe(pose, thing), stamp_ns=row * STEP_NS) for row, pose in enumerate(poses)]
    assert 20 < np.count_nonzero(frames[-1].labels) < np.count_nonzero(frames[0].labels) / 4
    aside = np.array([[0.0] * 6, [0.12, 0, 0, 0, 0, 0]])
    known = PoseCorrections(STEP_NS * np.array([5, 6]), aside)
    votes = ViewConsensus(SETTINGS)
    assert_found(votes.update(frames), thing)
    found = votes.update([], corrections=known)
    assert_found(found, thing)
    assert [item.views for item in found.objects] == [6]


def test_a_few_keyframes_that_move_are_asked_as_all_would_be() -> None:
    """What is said of and by those that stay is kept, and is what it would be if all were asked."""
    frames, known = displaced()
    some = PoseCorrections(known.stamps_ns, np.where(np.arange(12)[:, None] % 3 == 1, known.twists, 0.0))
    few, all_of_them = ViewConsensus(SETTINGS), ViewConsensus(SETTINGS)
    for votes in (few, all_of_them):
        votes.update(frames)
    few.update([], corrections=some)
    graph = all_of_them._graph
    for row, twist in enumerate(some.twists):
        graph._placed[row] = replace(graph._placed[row], calibration=Calibration(1.0, (1e-12, 0.0, 0.0)))
        assert np.any(twist) == (row % 3 == 1)
    all_of_them.update([], corrections=some)
    said = [np.unique(votes._graph.observations, axis=0) for votes in (few, all_of_them)]
    assert len(said[0]) > 100
    differ = {tuple(row) for row in said[0].tolist()} ^ {tuple(row) for row in said[1].tolist()}
    assert len(differ) < 0.02 * len(said[0])
    assert_same(few.update([]), all_of_them.update([]), numbered=True)
