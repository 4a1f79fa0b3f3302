"""Keyframes are chosen by capture time and motion."""

import numpy as np
import pytest

from spot3d.segments.keyframes import Keyframes
from spot3d.segments.settings import SegmentsSettings

MS = 1_000_000
SETTINGS = SegmentsSettings(interval_s=0.3, motion_m=0.02, motion_rad=0.02, still_s=1.0)


def pose(x: float = 0.0, turn: float = 0.0) -> np.ndarray:
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, -s, 0, x], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def chosen(steps: list[tuple[int, np.ndarray]], settings: SegmentsSettings = SETTINGS) -> list[int]:
    """Stamps in milliseconds of the keyframes among frames at these milliseconds with these poses."""
    keyframes = Keyframes(settings)
    return [ms for ms, T in steps if keyframes.is_keyframe(ms * MS, T)]


@pytest.mark.parametrize(
    ("name", "steps", "expected"),
    [
        ("the first", [(0, pose())], [0]),
        ("too soon, however fast", [(0, pose()), (200, pose(1.0))], [0]),
        ("far enough", [(0, pose()), (300, pose(0.03))], [0, 300]),
        ("not far enough", [(0, pose()), (300, pose(0.019))], [0]),
        ("turned", [(0, pose()), (300, pose(turn=0.021))], [0, 300]),
        ("not turned enough", [(0, pose()), (300, pose(turn=0.019))], [0]),
        ("slow motion adds up", [(0, pose()), (300, pose(0.015)), (400, pose(0.03))], [0, 400]),
        ("still", [(0, pose()), (900, pose()), (1000, pose())], [0, 1000]),
        ("another recording", [(5000, pose()), (5100, pose()), (0, pose()), (100, pose(1.0))], [5000, 0]),
        ("the same stamp again", [(0, pose()), (100, pose(1.0)), (100, pose(1.0))], [0]),
        ("half way round", [(0, pose()), (300, pose(turn=np.pi))], [0, 300]),
    ],
)
def test_choice(name: str, steps: list[tuple[int, np.ndarray]], expected: list[int]) -> None:
    assert chosen(steps) == expected, name


def test_about_three_a_second_of_a_moving_camera_and_one_of_a_still_one() -> None:
    frames = range(0, 10_000, 33)
    assert len(chosen([(ms, pose(ms * 1e-3)) for ms in frames])) == 31
    assert len(chosen([(ms, pose()) for ms in frames])) == 10


def test_without_keyframes_none_is_one() -> None:
    assert chosen([(0, pose()), (2000, pose(1.0))], SETTINGS.model_copy(update={"enabled": False})) == []


def test_a_pose_that_changes_in_place_is_not_what_was_remembered() -> None:
    keyframes, T = Keyframes(SETTINGS), pose()
    assert keyframes.is_keyframe(0, T)
    T[0, 3] = 1.0
    assert keyframes.is_keyframe(300 * MS, T)
