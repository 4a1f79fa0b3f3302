"""What becomes of objects that an update does not look at anew, and what those are that are put together."""

from dataclasses import replace

import numpy as np
from fusion_room import orbit, rotation_z
from numpy.typing import NDArray
from voting_room import SETTINGS, keyframe

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject, FoundObjects
from spot3d.fusion.objects.consensus import ViewConsensus, _one_of
from spot3d.fusion.objects.keyframes import Keyframe

STEADY = SETTINGS.model_copy(update={"tau_share": 0.0})
"""From the third keyframe on the rules stay as they are: an update looks at what new keyframes see alone."""


def room(number: int, count: int, heat: float) -> list[Keyframe]:
    """Keyframes of one of several rooms that are far apart and look alike."""
    away = np.eye(4)
    away[0, 3] = 6.0 * number
    return [keyframe(pose, heat=heat, told=away @ pose) for pose in orbit(count)]


def places(found: FoundObjects) -> dict[int, int]:
    """The room that each object is in, by its number."""
    return {item.id: round(float(item.box.centre[0]) / 6) for item in found.objects}


def test_views_that_take_an_object_for_background_make_it_colder() -> None:
    frames = room(0, 6, heat=0.6)
    frames[::2] = [replace(frame, labels=np.zeros_like(frame.labels)) for frame in frames[::2]]
    found = ViewConsensus(STEADY).update(frames)
    np.testing.assert_allclose([item.confidence for item in found.objects], 3 * 0.6 / (6 + STEADY.views_tau), rtol=1e-6)


def test_numbers_are_given_once_though_an_update_gives_none() -> None:
    votes, (first, *others) = ViewConsensus(STEADY), room(1, 4, heat=0.6)
    votes.update(room(0, 4, heat=0.6))
    assert len(votes.update([first]).objects) == 3, "one view is too few"
    assert places(votes.update(others)) == {1: 0, 2: 0, 3: 0, 4: 1, 5: 1, 6: 1}


def part(number: int, confidence: float, views: int, points: int, colour: NDArray[np.float64]) -> FoundObject:
    return FoundObject(number, Box3D(np.zeros(3), np.ones(3), rotation_z(0)), confidence, views, points, colour)


def test_a_whole_has_the_first_number_the_most_heat_and_views_and_all_points_of_its_parts() -> None:
    red, green, blue = 100 * np.eye(3)
    box = Box3D(np.ones(3), np.ones(3), rotation_z(0))
    parts = [part(5, 0.3, 9, 100, red), part(0, 0.1, 12, 500, green), part(3, 0.7, 4, 400, blue)]
    whole = _one_of(parts, box)
    assert (whole.id, whole.confidence, whole.views, whole.points) == (3, 0.7, 12, 1000)
    np.testing.assert_allclose(whole.colour, (10, 50, 40))
    assert whole.box is box
