"""What is not there any more: which segments are of it, and what becomes of the objects."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, THREE, look_at, standing
from numpy.typing import NDArray
from voting_room import POSES, SETTINGS, agreed, assert_found, keyframe, keyframes

from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.gone import gone_segments
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.views import BACKGROUND, THROUGH, WHOLE

FRAME = 20
"""The view that the segment in question is of."""


def said(*answers: tuple[int, int], row: int = 1) -> NDArray[np.int32]:
    """What views say of the segment in a row: each view's number, and what it says."""
    return np.array([(row, view, what, -1) for view, what in answers], np.int32).reshape(-1, 4)


def through(first: int, end: int) -> list[tuple[int, int]]:
    return [(view, THROUGH) for view in range(first, end)]


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([], False),
        (through(21, 30), False),
        (through(21, 31), True),
        (through(10, 20) + through(21, 30), False),  # views from before it was there
        ([*through(21, 31), (31, WHOLE)], False),
        ([(31, BACKGROUND), *through(21, 31)], False),  # in whatever order they say it
        ([*through(21, 26), (26, BACKGROUND), *through(27, 37)], True),
        ([*through(21, 26), (26, BACKGROUND), *through(27, 36)], False),
        ([(view, WHOLE) for view in range(21, 60)] + through(60, 70), True),
    ],
)
def test_the_ten_latest_of_later_views_look_through_it(answers: list[tuple[int, int]], expected: bool) -> None:
    others = np.concatenate((said(*through(0, 9), row=0), said(*through(25, 35), row=2)))
    told = np.random.default_rng(0).permutation(np.concatenate((said(*answers), others)))
    np.testing.assert_array_equal(gone_segments(told, np.array([0, FRAME, 3])), [False, expected, True])


def test_of_nothing_there_is_nothing() -> None:
    assert gone_segments(np.zeros((0, 4), np.int32), np.zeros(0, np.int64)).shape == (0,)
    assert not gone_segments(np.zeros((0, 4), np.int32), np.zeros(3, np.int64)).any()


def without_middle(poses: list[NDArray[np.float64]], number: int) -> list[Keyframe]:
    """Keyframes of the room once the second of three things is gone."""
    left = THREE[0], THREE[2]
    return [keyframe(pose, left, labels={0: 1, 1: 3}, number=number + row) for row, pose in enumerate(poses)]


def test_what_is_taken_away_is_no_object_once_as_many_keyframes_look_through_it() -> None:
    votes = ViewConsensus(SETTINGS)
    assert_found(votes.update(keyframes()))
    before, after = (
        votes.update(without_middle(POSES[first:last], 12 + first))
        for first, last in ((0, SETTINGS.views_min - 1), (SETTINGS.views_min - 1, SETTINGS.views_min))
    )
    assert_found(before)
    assert_found(after, (THREE[0], THREE[2]))
    assert after.left_out == {"no longer there": 1}


def test_what_comes_back_is_the_same_object_again() -> None:
    votes = ViewConsensus(SETTINGS)
    votes.update(keyframes())
    assert [item.id for item in votes.update(without_middle(POSES[:6], 12)).objects] == [1, 3]
    again = votes.update([keyframe(pose, number=18 + row) for row, pose in enumerate(POSES[:1])])
    assert [item.id for item in again.objects] == [1, 2, 3]


def test_what_was_not_there_before_is_an_object() -> None:
    """The views that looked through its place are older than those that see it."""
    frames = [*without_middle(POSES, 0), *keyframes()[: SETTINGS.views_min]]
    assert_found(agreed(frames, object_share=0.2))


def test_what_takes_the_place_of_something_is_not_joined_with_it() -> None:
    low = standing(0.02, 0.12, (0.16, 0.12, 0.06), colour=(40, 160, 60))
    now = (THREE[0], low, THREE[2])
    frames = [*keyframes(), *(keyframe(pose, now, number=12 + row) for row, pose in enumerate(POSES))]
    assert_found(agreed(frames), now)


def one_side(frame: Keyframe, left: bool, reach: float) -> Keyframe:
    """The keyframe with depth on one side of the middle of the image alone, and so many pixels beyond."""
    columns = np.arange(CAMERA.width)
    seen = columns < CAMERA.cx + reach if left else columns > CAMERA.cx - reach
    return replace(frame, depth=frame.depth * seen, labels=np.where(seen, frame.labels, 0).astype(np.uint8))


def test_what_is_looked_through_side_by_side_is_gone_as_well() -> None:
    """No view looks through most of what was seen of it."""
    wide = standing(0.0, 0.0, (0.5, 0.08, 0.16), colour=(40, 160, 60))
    views = [look_at((x, -1.0, 0.7)) for x in np.linspace(-0.4, 0.4, 12)]
    frames = [one_side(keyframe(pose, (wide,), number=row), row % 2 == 0, 15) for row, pose in enumerate(views)]
    assert len(agreed(frames).objects) == 1
    for left in (True, False):
        frames += [one_side(keyframe(pose, (), number=len(frames) + row), left, 0) for row, pose in enumerate(views)]
    found = agreed(frames, keyframe_limit=100)
    assert (found.objects, found.left_out) == ([], {"no longer there": 1})


def test_what_something_hides_is_not_taken_for_gone() -> None:
    screen = standing(-0.25, 0.3, (1.4, 0.02, 0.6), colour=(9, 9, 9))
    hidden = [keyframe(pose, labels={}, room=(*ROOM, screen), number=12 + row) for row, pose in enumerate(POSES)]
    found = agreed(keyframes() + hidden)
    assert "no longer there" not in found.left_out
