"""What keyframes saw is where it would be, had depth's scale and the camera's turn been known with them."""

from dataclasses import replace

import numpy as np
from voting_room import keyframes

from spot3d.fusion.objects.calibration import Change, change_segments, changed_view
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import view_of
from spot3d.trajectory import rotation_from_vector


def test_a_changed_keyframe_is_one_that_was_seen_like_that() -> None:
    before, now, factor = np.array((0.02, 0.0, -0.01)), np.array((-0.01, 0.03, 0.02)), 1.03
    first = keyframes()[0]
    T = first.T_map_camera.copy()
    T[:3, :3] = T[:3, :3] @ rotation_from_vector(before).T @ rotation_from_vector(now)
    planes = first.planes * (1, 1, 1, factor)
    then = replace(first, T_map_camera=T, depth=first.depth * np.float32(factor), planes=planes)
    changed, seen = SegmentTable(), SegmentTable()
    changed.extend(first, 0)
    seen.extend(then, 0)
    change = Change.of(view_of(first), factor, before, now)
    change_segments(changed, np.arange(len(changed)), change)
    for name, within in (("places", 1e-4), ("support", 2e-3), ("blur", 1e-3)):
        np.testing.assert_allclose(getattr(changed, name).rows, getattr(seen, name).rows, atol=within, err_msg=name)
    np.testing.assert_allclose(changed.spheres.rows[:, 3], seen.spheres.rows[:, 3], rtol=0.1)
    view, other = changed_view(view_of(first), change), view_of(then)
    np.testing.assert_allclose(view.pose, other.pose, atol=1e-5)
    np.testing.assert_allclose(view.centre, other.centre, atol=1e-2)
    np.testing.assert_allclose(view.depth, other.depth, atol=2)


def test_changes_back_and_forth_end_where_they_began() -> None:
    first = keyframes()[0]
    segments, still = SegmentTable(), np.zeros(3)
    segments.extend(first, 0)
    tables = {name: getattr(segments, name).rows.copy() for name in ("places", "support", "blur", "spheres")}
    view = view_of(first)
    for factor, turn in [(1.02, np.array((0.02, -0.01, 0.01))), (1 / 1.02, still)] * 20:
        change = Change.of(view, factor, np.array((0.02, -0.01, 0.01)) - turn, turn)
        change_segments(segments, np.arange(len(segments)), change)
        view = changed_view(view, change)
    for name, rows in tables.items():
        np.testing.assert_allclose(getattr(segments, name).rows, rows, atol=1e-4, err_msg=name)
    np.testing.assert_allclose(view.pose, view_of(first).pose, atol=1e-5)
