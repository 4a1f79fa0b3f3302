"""Objects by the vote of keyframes, on a made-up table with perfect labels, shaken poses and labels that are wrong."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from fusion_room import CAMERA, FLOOR, TABLE, THREE, WALL, Cuboid, look_at, orbit, standing
from numpy.typing import NDArray
from voting_room import POSES, SETTINGS, agreed, assert_found, assert_same, described, keyframe, keyframes

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics
from spot3d.found_object import FoundObjects
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.objects import cluster_judge
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.found import ObjectViews, box_of
from spot3d.fusion.objects.keyframes import FusedFrame, Keyframe, keyframe_of
from spot3d.fusion.settings import FusionSettings


def elsewhere(room: int) -> NDArray[np.float64]:
    """How the poses of another room differ from those of the first."""
    away = np.eye(4)
    away[0, 3] = 6.0 * room
    return away


def rooms(count: int, each: int) -> list[Keyframe]:
    """Keyframes of one room after another; all look alike."""
    return [
        keyframe(pose, number=room * each + step, told=elsewhere(room) @ pose)
        for room in range(count)
        for step, pose in enumerate(orbit(each))
    ]


@pytest.fixture
def boxes_made(monkeypatch: pytest.MonkeyPatch) -> list[Box3D]:
    """Every box that is made from here on."""
    made: list[Box3D] = []

    def noted(seen: ObjectViews, up: NDArray[np.float64], clearance: float, rounded: bool) -> Box3D:
        made.append(box_of(seen, up, clearance, rounded))
        return made[-1]

    monkeypatch.setattr(cluster_judge, "box_of", noted)
    return made


def test_of_nothing_there_is_nothing() -> None:
    found = agreed([])
    assert (found.objects, found.left_out) == ([], {})
    np.testing.assert_array_equal(found.up, [0, 0, 1])


def test_three_things_on_a_table() -> None:
    found = agreed(keyframes())
    assert_found(found)
    assert [item.id for item in found.objects] == [1, 2, 3]
    np.testing.assert_allclose(found.up, [0, 0, 1], atol=1e-9)
    for item, thing in zip(found.objects, THREE, strict=True):
        bottom = item.box.centre[2] - item.box.size[2] / 2
        assert bottom == pytest.approx(SETTINGS.plane_distance, abs=2e-3)
        assert item.views == 12
        np.testing.assert_allclose(item.colour, thing.colour, atol=1)
        assert item.confidence == pytest.approx(12 * 0.6 / (12 + 0.05 * 12))  # tau: 5 % of the keyframes
    assert not found.left_out


@pytest.mark.parametrize("seed", range(5))
def test_three_things_though_poses_are_a_centimetre_off(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = []
    for pose in POSES:
        shaken = pose.copy()
        shaken[:3, 3] += rng.normal(0, 0.01, 3)
        frames.append(keyframe(pose, told=shaken))
    assert_found(agreed(frames), least=0.55)


def test_numbers_stay_while_keyframes_come() -> None:
    votes = ViewConsensus(SETTINGS)
    for frame in keyframes():
        found = votes.update([frame])
        assert [item.id for item in found.objects] == [1, 2, 3]
        for item, thing in zip(found.objects, THREE, strict=True):
            assert np.linalg.norm(item.box.centre - thing.centre) < 0.03


@pytest.mark.parametrize("batch", [1, 2, 5, 24])
@pytest.mark.parametrize("limit", [200, 20, 15])
def test_one_update_or_many_give_the_same(batch: int, limit: int) -> None:
    frames = rooms(3, 8)
    for row in range(0, 24, 5):
        frames[row] = keyframe(orbit(8)[row % 8], labels=dict(enumerate((1, 1, 2))), told=frames[row].T_map_camera)
    votes = ViewConsensus(SETTINGS.model_copy(update={"keyframe_limit": limit}))
    for start in range(0, 24, batch):
        found = votes.update(frames[start : start + batch])
    at_once = agreed(frames, keyframe_limit=limit)
    assert_same(found, at_once)
    assert len(found.objects) == (9 if limit == 200 else 6)


def test_the_same_keyframes_give_the_same_to_the_last_bit() -> None:
    first, second = (agreed(rooms(2, 6)) for _ in range(2))
    np.testing.assert_array_equal(described(first), described(second))


def test_an_update_before_the_first_keyframe_changes_nothing() -> None:
    """A run in one process begins with one, the processes do not: both are to describe boxes anew at the same time."""
    first, second = ViewConsensus(SETTINGS), ViewConsensus(SETTINGS)
    first.update([])
    for votes in (first, second):
        votes.update(keyframes())
    assert 0 < np.linalg.norm(second._described_up - (0, 0, 1)) < 0.01, (
        "up is not exactly what it is taken for at first"
    )
    np.testing.assert_array_equal(first._described_up, second._described_up)


def test_an_update_describes_what_new_keyframes_see(boxes_made: list[Box3D]) -> None:
    votes = ViewConsensus(SETTINGS)
    votes.update(rooms(10, 4))
    assert len(boxes_made) == 30
    boxes_made.clear()
    before = votes.update([])
    assert not boxes_made
    back = elsewhere(4) @ orbit(5)[2]
    after = votes.update([keyframe(orbit(5)[2], told=back)])
    assert len(boxes_made) == 3
    assert all(abs(box.centre[0] - 24.0) < 1 for box in boxes_made)
    assert [item.id for item in after.objects] == [item.id for item in before.objects]


def test_a_view_of_one_thing_leaves_its_neighbours_as_they_are(boxes_made: list[Box3D]) -> None:
    """They hang together by a view that has all three in one segment, and so are clustered anew."""
    votes = ViewConsensus(SETTINGS)
    votes.update([*keyframes(24), keyframe(POSES[5], labels={0: 1, 1: 1, 2: 1})])  # enough for tau
    boxes_made.clear()
    close = look_at((-0.3, -0.25, 0.3), (-0.36, 0.0, 0.05))
    frame = keyframe(close)
    assert np.unique(frame.labels).tolist() == [0, 1]
    assert_found(votes.update([frame]))
    assert [round(float(box.centre[0]), 1) for box in boxes_made] == [-0.3]


def test_boxes_follow_when_up_turns() -> None:
    """The first keyframe took a leaning plane for the table's: it is outvoted, and no box leans any more."""
    first = keyframe(POSES[0])
    tilt = np.array([0.0, np.sin(0.3), np.cos(0.3), 0.0])
    leaning = replace(first, planes=(tilt @ POSES[0])[None])
    votes = ViewConsensus(SETTINGS)
    assert votes.update([leaning]).up[2] < 0.96
    found = votes.update([keyframe(elsewhere(1) @ pose, things=(), shown=()) for pose in POSES[:3]])
    assert found.up[2] > 0.9999
    for frame in keyframes(4):
        found = votes.update([frame])
    assert all(item.box.rotation[2, 2] > 0.9999 for item in found.objects)


@pytest.mark.parametrize("wrong", [{0: 1, 1: 1, 2: 2}, {0: 1, 1: 1, 2: 1}])
def test_a_third_of_views_that_have_two_in_one_do_not_join_them(wrong: dict[int, int]) -> None:
    frames = [keyframe(pose, labels=wrong if row % 3 == 1 else None) for row, pose in enumerate(POSES)]
    assert_found(agreed(frames))


def test_a_third_of_views_that_have_one_in_two_do_not_divide_it() -> None:
    frames = keyframes()
    for row in range(0, 12, 3):
        labels = frames[row].labels.copy()
        v, u = np.nonzero(labels == 2)
        labels[v, u] = np.where(u < np.median(u), 2, 4)
        more = np.append(frames[row].heat, np.float32(0.6)), np.append(frames[row].stands_on, np.int8(0))
        frames[row] = replace(frames[row], labels=labels, heat=more[0], stands_on=more[1])
    assert_found(agreed(frames))


def test_what_most_views_have_for_background_is_no_object() -> None:
    frames = [keyframe(pose, labels=None if row < 3 else {0: 1, 2: 2}) for row, pose in enumerate(POSES)]
    found = agreed(frames)
    assert_found(found, (THREE[0], THREE[2]))
    assert found.left_out == {"background in most views": 1}


def test_a_camera_that_steps_back_loses_nothing() -> None:
    """Beyond `range_max` nobody looks for objects."""
    back = [look_at((x, -2.3, 1.2)) for x in np.linspace(-0.3, 0.3, 36)]
    frames = keyframes() + [keyframe(pose, labels={}, number=12 + row) for row, pose in enumerate(back)]
    assert_found(agreed(frames, range_max=1.9))
    assert agreed(frames).left_out == {"background in most views": 3}


LARGE = standing(0.0, 0.1, (1.1, 0.1, 0.1), colour=(1, 2, 3))
SMALL = standing(0.0, 0.0, (0.013, 0.013, 0.1), colour=(1, 2, 3))
SHEET = standing(0.0, 0.0, (0.2, 0.2, 0.004), colour=(1, 2, 3))


@pytest.mark.parametrize(
    ("thing", "frames", "reason"),
    [
        (LARGE, 12, "too large"),
        (SMALL, 12, "too small"),
        (SHEET, 12, "too thin"),
        (THREE[1], 2, "seen too seldom"),
    ],
)
def test_what_is_left_out_is_counted(thing: Cuboid, frames: int, reason: str) -> None:
    seen = [
        keyframe(look_at((x, -0.75, 0.6)), things=(thing,), shown=(thing,) if row < frames else ())
        for row, x in enumerate(np.linspace(-0.2, 0.2, 12))
    ]
    found = agreed(seen)
    assert not found.objects
    assert found.left_out == {reason: 1}


def test_what_is_thin_is_an_object_if_it_is_seen_to_lie_on_something() -> None:
    """The front edge of a board looks alike, but nothing is seen beneath it."""
    bar = standing(0.1, 0.0, (0.3, 0.1, 0.012))

    def found(supports: tuple[float, ...]) -> FoundObjects:
        return agreed([keyframe(pose, (bar,), supports=supports) for pose in POSES])

    lying, above_nothing = found((0.0,)), found((-0.3,))
    assert len(lying.objects) == 1
    assert (above_nothing.objects, above_nothing.left_out) == ([], {"too thin": 1})


def warm(frame: Keyframe, *heat: float) -> Keyframe:
    """The keyframe with its segments as hot as this."""
    return replace(frame, heat=np.array(heat, np.float32))


def test_what_is_cold_beside_what_is_hot_is_no_object() -> None:
    found = agreed([warm(frame, 0.8, 0.1, 0.7) for frame in keyframes()])
    assert_found(found, (THREE[0], THREE[2]))
    assert found.left_out == {"too cold": 1}


def test_a_single_view_does_not_tell_for_sure_that_something_is_cold() -> None:
    """Half as far below eps as an object's heat differs from view to view: by chance of one of them, not of all."""
    frames = [warm(frame, 0.8, 0.2, 0.7) for frame in keyframes()]
    assert_found(agreed(frames[:1]), least=0.3)
    assert_found(agreed(frames), (THREE[0], THREE[2]))


def test_a_cold_foot_is_a_part_of_what_would_fall_without_it() -> None:
    foot = standing(0.0, 0.0, (0.2, 0.2, 0.06), colour=(40, 160, 60))
    sign = replace(standing(0.0, 0.0, (0.03, 0.16, 0.3)), centre=(0.0, 0.0, 0.21))
    cube = replace(standing(0.0, 0.0, (0.12, 0.12, 0.12)), centre=(0.0, 0.0, 0.12))
    of_both = standing(0.0, 0.0, (0.2, 0.2, 0.36))

    def found(*things: Cuboid) -> FoundObjects:
        return agreed([warm(keyframe(pose, things=things, shown=things), 0.1, 0.8) for pose in POSES])

    whole, alone = found(foot, sign), found(foot, cube)
    assert_found(whole, (of_both,))
    assert (whole.objects[0].id, whole.left_out) == (1, {})
    assert_found(alone, (cube,))
    assert alone.left_out == {"too cold": 1}


def test_what_turns_out_to_be_cold_goes() -> None:
    votes = ViewConsensus(SETTINGS)
    frames = [keyframe(pose) for pose in POSES]
    assert len(votes.update([warm(frame, 0.3, 0.3, 0.9) for frame in frames[:3]]).objects) == 3
    found = votes.update([warm(frame, 0.05, 0.05, 0.9) for frame in frames[3:]])
    assert_found(found, (THREE[2],))
    assert found.left_out == {"too cold": 2}


def test_a_new_object_waits_for_a_second_update_while_the_stream_goes_on() -> None:
    two, three = (
        [keyframe(pose, shown=shown, labels=labels) for pose in POSES]
        for shown, labels in ((THREE[:2], {0: 1, 1: 2}), (THREE, None))
    )
    votes = ViewConsensus(SETTINGS)
    assert_found(votes.update(two[:2], lasting=True), THREE[:2], least=0.5)  # there has been no update before
    votes.update(two[2:4], lasting=True)
    waits = votes.update(three[4:], lasting=True)
    assert_found(waits, THREE[:2])
    assert waits.left_out["seen too seldom"] == 1
    last = votes.update([])  # of a stream that is over
    assert_found(last)
    assert not last.left_out
    assert_same(votes.update([], lasting=True), last)


def test_with_fewer_keyframes_than_an_object_needs_all_of_them_must_see_it() -> None:
    votes = ViewConsensus(SETTINGS)
    assert_found(votes.update([keyframe(POSES[0])]), least=0.3)
    away = keyframe(POSES[0], things=(), shown=(), told=elsewhere(1) @ POSES[0])
    later = votes.update([away, away, away])
    assert not later.objects, "what one of four has seen is judged as in every longer run"
    assert later.left_out == {"seen too seldom": 3}


def test_the_oldest_keyframes_go_and_their_objects_with_them() -> None:
    votes = ViewConsensus(SETTINGS.model_copy(update={"keyframe_limit": 20}))
    kept: list[int] = []
    for start, count in ((0, 3), (8, 6), (16, 6), (24, 9)):
        found = votes.update(rooms(4, 8)[start : start + 8])
        assert len(found.objects) == count, start
        if start == 24:
            kept = [item.id for item in found.objects]
        rooms_left = {round(item.box.centre[0] / 6) for item in found.objects}
        assert max(rooms_left) == start // 8
    assert len(votes) <= 20
    assert votes.dropped == 32 - len(votes)
    assert kept == list(range(4, 13)), "numbers stay, and none is given twice"
    assert found.left_out.keys() <= {"seen too seldom"}


def test_a_camera_that_stands_still_crowds_nothing_out() -> None:
    votes = ViewConsensus(SETTINGS.model_copy(update={"keyframe_limit": 20}))
    before = votes.update(keyframes())
    still = keyframe(POSES[0], told=elsewhere(1) @ POSES[0])
    for _ in range(20):
        after = votes.update([still])
    assert (len(votes), votes.dropped) == (12 + 5, 0)
    ids = {item.id for item in before.objects}
    assert ids <= {item.id for item in after.objects}


def test_what_comes_and_goes_before_a_still_camera_is_found_and_forgotten() -> None:
    votes = ViewConsensus(SETTINGS)
    votes.update([keyframe(POSES[0], shown=THREE[:2], labels={0: 1, 1: 2})] * 8)
    found = votes.update([keyframe(POSES[0])] * 5)
    assert len(found.objects) == 3
    gone = votes.update([keyframe(POSES[0], shown=THREE[:1], labels={0: 1})] * 5)
    assert len(gone.objects) == 1


def test_a_room_that_is_left_is_forgotten_without_a_trace() -> None:
    """After as many keyframes of another room the consensus is that of one that has seen this room alone."""
    votes = ViewConsensus(SETTINGS.model_copy(update={"keyframe_limit": 10}))
    votes.update(rooms(1, 8))
    frames = [keyframe(pose, told=elsewhere(3) @ pose) for pose in orbit(12)]
    for frame in frames:
        found = votes.update([frame])
    assert_same(found, agreed(frames[-len(votes) :]))


def test_fewer_keyframes_than_an_object_needs_may_be_all_that_is_kept() -> None:
    votes = ViewConsensus(SETTINGS.model_copy(update={"keyframe_limit": 1}))
    for frame in keyframes(4):
        assert len(votes.update([frame]).objects) == 3
    assert (len(votes), votes.dropped) == (1, 3)


def test_keyframes_that_wait_are_bounded_too() -> None:
    votes = ViewConsensus(SETTINGS.model_copy(update={"keyframe_limit": 5}))
    for frame in keyframes():
        votes.add(frame)
    assert (len(votes), votes.dropped) == (5, 7)
    assert_found(votes.update(votes.take_waiting()), least=0.6)
    assert len(votes) == 5


def test_what_was_joined_and_parts_again_has_its_number() -> None:
    """Objects that many views have in one are one, until views that are better have come."""
    votes = ViewConsensus(SETTINGS)
    apart = keyframes(4)
    before = {item.id: item.box.centre for item in votes.update(apart).objects}
    joined = votes.update([keyframe(pose, labels={0: 1, 1: 1, 2: 2}) for pose in orbit(30)])
    numbers = {item.id for item in joined.objects}
    assert numbers <= {1, 2, 3}
    after = votes.update(keyframes(40))
    assert_found(after)
    assert {item.id for item in after.objects} == {1, 2, 3}
    for item in after.objects:
        assert np.linalg.norm(before[item.id] - item.box.centre) < 0.03


def test_two_tables_of_different_height() -> None:
    shelf = Cuboid((0.45, 0.3, 0.1), (0.4, 0.4, 0.2), colour=(60, 60, 60))
    low = standing(-0.2, 0.0, (0.12, 0.1, 0.14))
    high = Cuboid((0.45, 0.3, 0.26), (0.1, 0.12, 0.12), 0.4, (40, 160, 60), 1.0)
    things = (low, high)
    frames = keyframes(things=things, room=(TABLE, FLOOR, WALL, shelf), supports=(0.0, 0.2))
    found = agreed(frames)
    assert_found(found, things, least=0.75)
    bottoms = sorted(item.box.centre[2] - item.box.size[2] / 2 for item in found.objects)
    assert bottoms == pytest.approx([0.005, 0.205], abs=2e-3)


def test_keyframes_without_planes() -> None:
    found = agreed(keyframes(supports=()))
    assert_found(found, least=0.6)
    np.testing.assert_array_equal(found.up, [0, 0, 1])


def test_keyframes_without_segments_and_without_depth() -> None:
    frames = keyframes()
    frames[2] = replace(frames[2], labels=np.zeros_like(frames[2].labels))
    frames[5] = replace(frames[5], depth=np.zeros_like(frames[5].depth))
    frames[7] = replace(frames[7], labels=np.where(frames[7].labels == 1, frames[7].labels, 0).astype(np.uint8))
    found = agreed(frames)
    assert_found(found)
    assert np.isfinite(described(found)).all()
    assert not agreed([frames[2], frames[5]]).objects


def test_segments_on_another_lattice() -> None:
    """A segmenter that looks at a smaller image."""
    half = Intrinsics(75.0, 75.0, 39.5, 29.5, 80, 60)
    frames = []
    for frame in keyframes():
        small = FrameSegments(
            np.ascontiguousarray(frame.labels[::2, ::2]), frame.heat, frame.planes, frame.stands_on, half
        )
        fused = FusedFrame(frame.stamp_ns, frame.colour, frame.depth, CAMERA, frame.T_map_camera, frame.T_map_camera)
        frames.append(keyframe_of(fused, small))
    assert frames[0].labels.shape == CAMERA.shape
    assert_found(agreed(frames), least=0.6)


def test_cameras_may_differ() -> None:
    frames = keyframes()
    for row in range(0, 12, 2):
        k, frame = CAMERA, frames[row]
        half = Intrinsics(k.fx / 2, k.fy / 2, k.cx / 2, k.cy / 2, k.width // 2, k.height // 2)
        images = (np.ascontiguousarray(image[::2, ::2]) for image in (frame.labels, frame.colour, frame.depth))
        labels, colour, depth = images
        frames[row] = replace(frame, labels=labels, colour=colour, depth=depth, camera=half)
    assert_found(agreed(frames), least=0.75)


def test_a_keyframe_that_cannot_be_taken_in_spares_the_others() -> None:
    votes = ViewConsensus(SETTINGS)
    frames = keyframes()
    frames[4] = replace(frames[4], T_map_camera=np.zeros((4, 4)))
    with pytest.raises(np.linalg.LinAlgError):
        votes.update(frames)
    found = votes.update([])
    assert_found(found)
    assert {item.views for item in found.objects} == {11}
    assert_same(found, agreed(frames[:4] + frames[5:]), numbered=True)


def test_what_fails_in_an_update_is_made_good_in_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    votes, fails = ViewConsensus(SETTINGS), [True]

    def failing_once(seen: ObjectViews, up: NDArray[np.float64], clearance: float, rounded: bool) -> Box3D:
        if fails.pop() if fails else False:
            raise ValueError("no box")
        return box_of(seen, up, clearance, rounded)

    monkeypatch.setattr(cluster_judge, "box_of", failing_once)
    with pytest.raises(ValueError, match="no box"):
        votes.update(keyframes())
    assert_same(votes.update([]), agreed(keyframes()), numbered=True)


def test_keyframes_may_come_while_an_update_runs() -> None:
    """`add` and `take_waiting` in one thread, `update` in another."""
    votes, frames = ViewConsensus(SETTINGS), rooms(4, 12)
    results: list[FoundObjects] = []
    for frame in frames[:12]:
        votes.add(frame)
    waiting = votes.take_waiting()
    thread = threading.Thread(target=lambda: results.append(votes.update(waiting)))
    thread.start()
    for frame in frames[12:]:
        votes.add(frame)
        assert len(votes) >= 1
    thread.join()
    assert_same(results[0], agreed(frames[:12]), numbered=True)
    assert_same(votes.update(votes.take_waiting()), agreed(frames))


def test_defaults_take_what_a_live_camera_sees() -> None:
    """The default settings, with the same three things."""
    assert_found(ViewConsensus(FusionSettings()).update(keyframes()))
