"""Steps of the views' consensus: one view's statements on segments, and an update with one more keyframe."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.bench import reference
from spot3d.bench.material import Material, walking
from spot3d.fusion.objects.agreement import Statements
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.keyframes import FusedFrame, Keyframe, keyframe_of
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import BACKGROUND, DIVIDED, OBJECT, WHOLE, View, ask, eyes_of, view_of
from spot3d.geometry.downsampling import to_lattice
from spot3d.segments.finder import find_segments
from spot3d.settings import Settings

Add = Callable[[str, Callable[[], object], str, Callable[[], object], bool, list[NDArray[Any]]], None]
"""Measures a step: its name, the step, the reference's name, the reference, whether that is slow, arrays read."""


def consensus_steps(add: Add, m: Material, settings: Settings) -> None:
    """Measure the steps with all frames of the material as keyframes; their number stays constant."""
    keyframes = [_keyframe(m, index, settings) for index in range(len(m))]
    views, table = [view_of(keyframe) for keyframe in keyframes], SegmentTable()
    rows_of = [table.extend(keyframe, number) for number, keyframe in enumerate(keyframes)]
    places, spheres = table.places.rows, table.spheres.rows
    said, label = np.empty((2, len(table)), np.uint8)
    votes = ViewConsensus(settings.fusion.model_copy(update={"keyframe_limit": len(m)}))
    votes.update(keyframes)
    statements = _statements(table, views, rows_of)
    first = views[0]
    add(
        f"views, what one says of {len(table)} segments",
        walking(len(m), lambda i: ask(views[i], places, spheres, said, label)),
        "NumPy, segment by segment",
        walking(
            len(m),
            lambda i: reference.said_by_view(views[i].labels, views[i].depth, views[i].pose, views[i].focal, places),
        ),
        True,
        [first.labels, first.depth, places],
    )
    add(
        "consensus, a keyframe more",
        walking(len(m), lambda i: votes.update([keyframes[i]])),
        "sets, all clusters, no boxes",
        lambda: reference.clusters(statements, settings.fusion.views_min, settings.fusion.object_share),
        True,
        [keyframes[0].labels, keyframes[0].depth, keyframes[0].colour, places],
    )


def _keyframe(m: Material, index: int, settings: Settings) -> Keyframe:
    colour, depth, heat = m.frames[index].colour, m.depth[index], m.heat[index]
    seen = to_lattice(colour, depth, heat, m.camera, settings.fusion.lattice_width, settings.fusion.grazing_cos)
    frame = FusedFrame(index, seen.colour, seen.depth, seen.camera, m.pose(index), m.pose(index))
    return keyframe_of(frame, find_segments(colour, depth, heat, m.camera, settings.segments))


def _statements(table: SegmentTable, views: list[View], rows_of: list[NDArray[np.int32]]) -> Statements:
    """The statements of all views on other views' segments."""
    observed, within = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2), np.int64)]
    divided, background = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    said, label = np.empty((2, len(table)), np.uint8)
    for number, view in enumerate(views):
        ask(view, table.places.rows, table.spheres.rows, said, label)
        others = table.frame.rows != number
        rows = np.flatnonzero(others & (said >= OBJECT))
        held = np.flatnonzero(others & (said == WHOLE))
        holder = rows_of[number][label[held]].astype(np.int64)
        observed.append(np.column_stack((rows, np.full(len(rows), number))))
        within.append(np.column_stack((held, holder))[holder >= 0])
        divided.append(np.flatnonzero(others & (said == DIVIDED)))
        background.append(np.flatnonzero(others & (said == BACKGROUND)))
    return Statements(
        table.frame.rows.copy(),
        np.concatenate(observed),
        np.concatenate(within),
        np.concatenate(divided),
        np.concatenate(background),
        table.spheres.rows[:, :3].astype(np.float64),
        eyes_of(views),
    )
