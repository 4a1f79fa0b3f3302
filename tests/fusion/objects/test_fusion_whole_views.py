"""A thing that most views have in pieces, as some of it is out of sight, is as large as those have it that see all."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import THREE, Cuboid, standing
from voting_room import POSES, SETTINGS, keyframe

from spot3d.boxes import iou_matrix_3d
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.views import BACKGROUND, DIVIDED, OBJECT, WHOLE
from spot3d.fusion.objects.whole_views import wholes

BASE = standing(0.0, 0.0, (0.12, 0.12, 0.03))
POLE = Cuboid((0.0, 0.0, 0.18), (0.05, 0.05, 0.3), colour=(40, 160, 60))
SHADE = Cuboid((0.06, 0.0, 0.36), (0.16, 0.05, 0.06), colour=(50, 60, 200))
LAMP = (BASE, POLE, SHADE)
ALL = Cuboid((0.04, 0.0, 0.195), (0.2, 0.12, 0.39))
IN_PIECES, AS_ONE = {0: 1, 1: 2}, {0: 1, 1: 1, 2: 1}


def without(frame: Keyframe, thing: Cuboid) -> Keyframe:
    """The same keyframe that does not see a thing."""
    unseen = (frame.colour == thing.colour).all(axis=-1)
    return replace(frame, labels=np.where(unseen, 0, frame.labels), depth=np.where(unseen, 0, frame.depth))


def found(whole: tuple[int, ...]) -> list[float]:
    """IoU of the lamp and what is found of it, where so numbered views see all of it."""
    frames = [
        keyframe(pose, LAMP, AS_ONE, number=number)
        if number in whole
        else without(keyframe(pose, LAMP, IN_PIECES, number=number), SHADE)
        for number, pose in enumerate(POSES)
    ]
    objects = ViewConsensus(SETTINGS).update(frames).objects
    return [float(iou_matrix_3d([ALL.box()], [item.box])[0, 0]) for item in objects]


def test_a_lamp_whose_shade_some_views_see_has_its_shade() -> None:
    (overlap,) = found(whole=(1, 4, 7, 10))
    assert overlap > 0.7


def test_too_few_views_do_not_make_a_thing_larger() -> None:
    (overlap,) = found(whole=(4, 7))
    assert overlap < 0.5


def test_what_holds_some_of_another_thing_as_well_has_nothing_whole() -> None:
    """Rows 0, 1 and 2 are of the pieces 5, 6 and of another thing, 7; rows 3 to 5 are of later views."""
    cluster = np.array([5, 6, 7, 8, 9, 5])
    said = np.array(
        [
            *((0, 1, WHOLE, 3), (1, 1, WHOLE, 3), (2, 1, BACKGROUND, -1)),
            *((0, 2, WHOLE, 4), (1, 2, WHOLE, 4), (2, 2, WHOLE, 4)),
            *((0, 3, WHOLE, 5), (1, 3, DIVIDED, -1), (2, 3, OBJECT, -1)),
        ],
        np.int32,
    )
    rows = wholes([(5, 6), (7,)], said, cluster)
    assert set(rows) == {(5, 6)}
    assert rows[5, 6].tolist() == [3]


@pytest.mark.parametrize("things", [[], [(5,), (6,)]])
def test_where_nothing_is_in_pieces_nothing_is_asked(things: list[tuple[int, ...]]) -> None:
    assert wholes(things, np.zeros((0, 4), np.int32), np.zeros(0, np.int64)) == {}


def test_things_that_stand_side_by_side_stay_as_they_are() -> None:
    frames = [keyframe(pose, number=number) for number, pose in enumerate(POSES)]
    assert len(ViewConsensus(SETTINGS).update(frames).objects) == len(THREE)
