"""What was taken for an object and is none is counted by the reason."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import THREE, orbit
from voting_room import agreed
from voting_room import keyframe as view_of_three

from spot3d.camera import Intrinsics
from spot3d.frame_segments import KEYFRAME_REASONS, OTHER, SEVERAL, TOO_LONG, WITHOUT_DEPTH
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.reasons import (
    GONE,
    MOSTLY_BACKGROUND,
    REASONS,
    TOO_COLD,
    TOO_LARGE,
    TOO_SELDOM,
    TOO_SMALL,
    TOO_THIN,
)
from spot3d.fusion.settings import FusionSettings
from spot3d_schemas.limits import MAX_COUNT

CAMERA = Intrinsics(fx=140.0, fy=140.0, cx=79.5, cy=59.5, width=160, height=120)
OBJECT, BACKGROUND, THROUGH, NOTHING = "object", "background", "through", "nothing"


def keyframe(stamp_ns: int, seen_as: str, heat: float, thickness: float) -> Keyframe:
    """A round thing, 29 cm wide and 1 m away, as one of the camera's views shows it; `THROUGH`: without it; `NOTHING`:
    no depth."""
    labels = np.zeros(CAMERA.shape, np.uint8)
    labels[40:80, 60:100] = seen_as == OBJECT
    depth = np.full(CAMERA.shape, 1.5, np.float32)
    if seen_as != THROUGH:
        depth[40:80, 60:100] = 1 + thickness * np.linspace(-1, 1, 40) ** 2
    if seen_as == NOTHING:
        depth[:] = 0
    return Keyframe(
        stamp_ns,
        labels,
        np.full((*CAMERA.shape, 3), 90, np.uint8),
        depth,
        CAMERA,
        np.eye(4),
        np.full(int(labels.max()), heat, np.float32),
        np.array([[0.0, -1.0, 0.0, 0.5]]),
        np.full(int(labels.max()), -1, np.int8),
    )


CASES = [
    ({}, 0.8, 0.1, (OBJECT,) * 3, None),
    ({"heat_min": 0.9}, 0.8, 0.1, (OBJECT,) * 3, TOO_COLD),
    ({"size_max": 0.2}, 0.8, 0.1, (OBJECT,) * 3, TOO_LARGE),
    ({"size_min": 0.5}, 0.8, 0.1, (OBJECT,) * 3, TOO_SMALL),
    ({"volume_min": 0.1}, 0.8, 0.1, (OBJECT,) * 3, TOO_SMALL),
    ({}, 0.8, 0.0, (OBJECT,) * 3, TOO_THIN),
    ({}, 0.8, 0.1, (OBJECT, NOTHING, NOTHING), TOO_SELDOM),
    ({"views_min": 1}, 0.8, 0.1, (OBJECT, *(BACKGROUND,) * 4), MOSTLY_BACKGROUND),
    ({"views_min": 2}, 0.8, 0.1, (OBJECT,) * 3 + (THROUGH,) * 2, GONE),
    ({"views_min": 2}, 0.8, 0.1, (THROUGH,) * 2 + (OBJECT,) * 3, None),
    ({"views_min": 2}, 0.8, 0.1, (OBJECT,) * 2 + (THROUGH,) * 2 + (OBJECT,), None),
    ({"views_min": 2}, 0.8, 0.1, (OBJECT,) * 3 + (THROUGH, BACKGROUND), None),
    ({"views_min": 2}, 0.8, 0.1, (OBJECT,) * 3 + (THROUGH, NOTHING), None),
]


@pytest.mark.parametrize(("settings", "heat", "thickness", "views", "reason"), CASES)
def test_each_reason_is_counted(
    settings: dict[str, float], heat: float, thickness: float, views: tuple[str, ...], reason: str | None
) -> None:
    consensus = ViewConsensus(FusionSettings(**settings))
    keyframes = [keyframe(number, seen_as, heat, thickness) for number, seen_as in enumerate(views)]
    agreed = consensus.update(keyframes)
    assert agreed.left_out == ({} if reason is None else {reason: 1})
    assert len(agreed.objects) == (reason is None)
    assert consensus.update([]).left_out == agreed.left_out, "an update says all, not only what is new"


def test_there_is_a_case_for_every_reason() -> None:
    assert {case[-1] for case in CASES} - {None} == set(REASONS)


def test_what_was_left_out_of_single_keyframes_is_counted_over_all() -> None:
    keyframes = [keyframe(number, OBJECT, 0.8, 0.1) for number in range(3)]
    told = [replace(item, left_out={TOO_LONG: 2, "of their own": 9}) for item in keyframes]
    assert ViewConsensus(FusionSettings()).update(told).left_out == {TOO_LONG: 6, OTHER: 27}


@pytest.mark.parametrize("reason", KEYFRAME_REASONS)
def test_of_more_than_a_message_can_state_the_most_is_stated(reason: str) -> None:
    keyframes = [replace(keyframe(number, OBJECT, 0.8, 0.1), left_out={reason: MAX_COUNT}) for number in range(3)]
    assert ViewConsensus(FusionSettings()).update(keyframes).left_out == {reason: MAX_COUNT}


def test_segments_without_depth_are_counted() -> None:
    """What is black, as a segmenter of colour finds it, and what has 19 pixels; 20 have a shape, label 5 has none."""
    keyframes = []
    for number in range(3):
        seen = keyframe(number, OBJECT, 0.8, 0.1)
        labels, depth = seen.labels.copy(), seen.depth.copy()
        labels[90:100, 60:100], labels[110, 60:79], labels[110, 79:99] = 2, 3, 4
        depth[90:100, 60:100] = 0
        heat, stands_on = np.full(5, 0.8, np.float32), np.full(5, -1, np.int8)
        keyframes.append(replace(seen, labels=labels, depth=depth, heat=heat, stands_on=stands_on))
    assert ViewConsensus(FusionSettings()).update(keyframes).left_out[WITHOUT_DEPTH] == 6


def test_segments_of_several_objects_are_counted() -> None:
    """Of two views of eight a segmenter joins what stands apart."""
    keyframes = [
        view_of_three(pose, labels={0: 1, 1: 1, 2: 2} if number in (2, 5) else None, number=number)
        for number, pose in enumerate(orbit(8))
    ]
    found = agreed(keyframes)
    assert (len(found.objects), found.left_out) == (len(THREE), {SEVERAL: 2})


def test_what_becomes_an_object_is_left_out_no_longer() -> None:
    consensus = ViewConsensus(FusionSettings())
    consensus.update([keyframe(0, OBJECT, 0.8, 0.1), keyframe(1, NOTHING, 0.8, 0.1), keyframe(2, OBJECT, 0.8, 0.1)])
    agreed = consensus.update([keyframe(3, OBJECT, 0.8, 0.1)])
    assert (len(agreed.objects), agreed.left_out) == (1, {})


def test_forgotten_keyframes_are_counted() -> None:
    consensus = ViewConsensus(FusionSettings(keyframe_limit=2))
    assert consensus.update([keyframe(number, OBJECT, 0.8, 0.1) for number in range(2)]).keyframes_dropped == 0
    assert consensus.update([keyframe(number, OBJECT, 0.8, 0.1) for number in range(2, 5)]).keyframes_dropped == 3
