"""What is forgotten with keyframes, and what moves with those that are seen anew."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import look_at, standing
from voting_room import keyframe, keyframes

from spot3d.calibration import Calibration
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.segment_graph import SegmentGraph
from spot3d.pose_corrections import PoseCorrections


def graph_of(frames: list[Keyframe]) -> SegmentGraph:
    graph = SegmentGraph()
    for frame in frames:
        graph.take_in(frame)
    graph.segments.touched.rows[:] = False
    return graph


def shifted(*stamps_ns: int) -> PoseCorrections:
    """These keyframes are known to have been 3 cm further along x, and all others where they were."""
    every = np.arange(12)
    return PoseCorrections(every, np.where(np.isin(every, stamps_ns)[:, None], (0.03, 0, 0, 0, 0, 0), 0.0))


def test_what_is_up_is_said_by_keyframes_that_are_there() -> None:
    frames = [replace(frame, planes=-frame.planes) for frame in keyframes(3)]
    graph = graph_of([*frames, keyframe(look_at((0.0, -0.95, 0.7)))])
    np.testing.assert_allclose(graph.up(), (0, 0, -1), atol=1e-6)
    graph.drop([0, 1, 2])
    np.testing.assert_allclose(graph.up(), (0, 0, 1), atol=1e-6)


def test_up_turns_with_the_camera() -> None:
    graph = graph_of(keyframes(3))
    graph.see_anew(Calibration(turn=(0.2, 0.0, 0.0)))
    assert 0.1 < np.arccos(graph.up() @ (0, 0, 1)) < 0.21


@pytest.mark.parametrize("cluster", [-1, 7])
def test_what_a_keyframe_spoke_of_is_touched_when_it_goes(cluster: int) -> None:
    """And what was one with its segments, whether it spoke of that or not."""
    apart = keyframe(look_at((3.0, 2.0, 0.7), (3, 3, 0)), (standing(3.0, 3.0, (0.2, 0.2, 0.2)),), number=2)
    graph = graph_of([*keyframes(2), apart])
    lone = np.flatnonzero(graph.segments.frame.rows == 2)
    assert len(lone) == 1
    assert not np.isin(graph.observations[:, :2], (lone[0],))[:, 0].any(), "nobody else sees it"
    graph.segments.cluster.rows[[0, lone[0]]] = cluster
    gone = graph.drop([0])
    assert gone == []
    near = graph.segments.frame.rows == 1
    assert graph.segments.touched.rows[near].all()
    assert graph.segments.touched.rows[~near].tolist() == [cluster >= 0]


def test_what_is_known_better_is_taken_into_account_once() -> None:
    graph, known = graph_of(keyframes(3)), shifted(1)
    graph.see_anew(Calibration(1.05), known)
    places, views = graph.segments.places.rows.copy(), [view.pose.copy() for view in graph.views.values()]
    graph.see_anew(Calibration(1.05), known)
    np.testing.assert_array_equal(graph.segments.places.rows, places)
    np.testing.assert_array_equal([view.pose for view in graph.views.values()], views)


def test_how_far_a_keyframe_sees_moves_with_it() -> None:
    graph = graph_of(keyframes(3))
    before = np.array([(*view.centre, view.reach) for view in graph.views.values()])
    graph.see_anew(Calibration(1.1), shifted(1))
    after = np.array([(*view.centre, view.reach) for view in graph.views.values()])
    assert (np.abs(after - before).max(axis=1) > 0.01).all()


def test_what_a_keyframe_that_moves_has_seen_or_spoken_of_is_touched() -> None:
    far = keyframe(look_at((3.0, 2.0, 0.7), (3, 3, 0)), (standing(3.0, 3.0, (0.2, 0.2, 0.2)),), number=2)
    graph = graph_of([*keyframes(2), far])
    aside = PoseCorrections(np.arange(3), np.array([[0.0] * 6, [9.0, 0, 0, 0, 0, 0], [0.0] * 6]))
    graph.see_anew(Calibration(), aside)  # to where it sees nothing of the others
    assert graph.segments.touched.rows.tolist() == (graph.segments.frame.rows < 2).tolist()
    graph.segments.touched.rows[:] = False
    aside.twists[2, 1] = 0.1
    graph.see_anew(Calibration(), aside)  # of whose segment nobody speaks
    assert graph.segments.touched.rows.tolist() == (graph.segments.frame.rows == 2).tolist()


def test_a_keyframe_without_segments_that_moves_is_asked_anew() -> None:
    blind = replace(keyframe(look_at((0.0, -0.95, 0.7)), labels={}), stamp_ns=2)
    graph = graph_of([*keyframes(2), blind])
    spoken = np.count_nonzero(graph.observations[:, 1] == 2)
    assert spoken > 0
    graph.see_anew(Calibration(), shifted(2))
    assert np.count_nonzero(graph.observations[:, 1] == 2) == spoken
