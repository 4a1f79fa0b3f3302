"""A frame seen from other places: surfaces stay where they are, what was hidden has no depth, holes stay holes."""

import numpy as np
from fusion_room import CAMERA, ROOM, THREE, look_at, view
from numpy.typing import NDArray

from spot3d.camera import back_project, invert
from spot3d.evaluate.moved_views import VIEWS, moved_views
from spot3d.frame import RgbdFrame

POSE = look_at((0, -0.95, 0.7))
SEEN = view(POSE, ROOM + THREE)


def frame(depth: NDArray[np.float32]) -> RgbdFrame:
    return RgbdFrame(5, SEEN.colour, depth, 1.0, CAMERA)


def test_the_first_is_the_frame_itself_and_the_others_are_elsewhere() -> None:
    views = moved_views(frame(SEEN.depth))
    assert len(views) == VIEWS
    np.testing.assert_array_equal(views[0].depth, SEEN.depth)
    np.testing.assert_array_equal(views[0].T_world_camera, np.eye(4))
    assert (np.diff([one.stamp_ns for one in views]) > 0).all()
    places = np.array([one.T_world_camera[:3, 3] for one in views if one.T_world_camera is not None])
    assert 0.1 < np.linalg.norm(places, axis=1).max() < 0.3


def test_what_is_seen_from_elsewhere_is_where_it_is() -> None:
    """Beside what the room's own rendering shows from there, but for the pixels at edges."""
    for one in moved_views(frame(SEEN.depth))[1:]:
        assert one.T_world_camera is not None
        rendered = view(POSE @ one.T_world_camera, ROOM + THREE)
        both = (one.depth > 0) & (rendered.depth > 0)
        assert both.mean() > 0.7
        assert np.mean(np.abs(one.depth - rendered.depth)[both] < 0.02) > 0.93
        assert np.mean((one.colour == rendered.colour).all(axis=-1)[both]) > 0.93


def test_what_was_hidden_has_no_depth_but_a_colour() -> None:
    sideways = moved_views(frame(SEEN.depth))[3]
    assert sideways.T_world_camera is not None
    rendered = view(POSE @ sideways.T_world_camera, ROOM + THREE)
    back = (rendered.depth > 0) & (sideways.depth == 0)
    assert back.mean() > 0.02
    assert sideways.colour[back].any(axis=-1).all()
    hidden = back_project(rendered.depth, CAMERA)[back]
    T = invert(sideways.T_world_camera)
    x, y, z = ((hidden - T[:3, 3]) @ T[:3, :3]).T
    u, v = (np.rint(f * a / z + c).astype(int) for f, a, c in ((CAMERA.fx, x, CAMERA.cx), (CAMERA.fy, y, CAMERA.cy)))
    inside = (u >= 0) & (u < CAMERA.width) & (v >= 0) & (v < CAMERA.height)
    assert np.mean(SEEN.depth[v[inside], u[inside]] < z[inside] - 0.02) > 0.5, "something was before most of it"


def test_a_hole_stays_a_hole() -> None:
    torn = SEEN.depth.copy()
    torn[70:85, 60:80] = 0
    for whole, one in zip(moved_views(frame(SEEN.depth))[1:], moved_views(frame(torn))[1:], strict=True):
        lost = np.count_nonzero((whole.depth > 0) & (one.depth == 0))
        assert 200 < lost < 450, "300 pixels, as large as they look from there"
        assert np.mean((whole.colour == one.colour).all(axis=-1)) > 0.95, "its colour moves with what is around it"


def test_a_frame_without_depth_has_none_elsewhere() -> None:
    views = moved_views(frame(np.zeros_like(SEEN.depth)))
    assert not any(one.depth.any() for one in views)
    assert all(one.colour.any() for one in views)
