"""The segments of one frame: as many as there are objects, each standing on the table."""

import numpy as np
from fusion_room import CAMERA, ROOM, THREE, look_at, view

from spot3d.camera import Intrinsics, invert
from spot3d.frame_segments import FrameSegments
from spot3d.geometry.planes import transform_plane
from spot3d.segments.finder import find_segments
from spot3d.segments.settings import SegmentsSettings

POSE = look_at((0, -0.95, 0.7))
FINE_CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)


def found(camera: Intrinsics, width: int = 320) -> FrameSegments:
    seen = view(POSE, ROOM + THREE, np.random.default_rng(0), camera)
    for array in (seen.colour, seen.depth, seen.heat):
        array.setflags(write=False)  # as those of messages are
    return find_segments(seen.colour, seen.depth, seen.heat, camera, SegmentsSettings(lattice_width=width))


def test_every_object_is_a_segment_on_the_table() -> None:
    segments = found(FINE_CAMERA)
    assert (segments.camera.width, segments.camera.height) == (320, 240)
    assert len(segments) == 3
    assert set(np.unique(segments.labels)) == {0, 1, 2, 3}
    assert (segments.heat > 0.5).all()
    assert set(segments.stands_on) == {0}
    table = transform_plane(segments.planes[0], POSE)
    np.testing.assert_allclose(table, [0, 0, 1, 0], atol=0.02)
    colours = view(POSE, ROOM + THREE, None, segments.camera).colour
    middles = {tuple(np.median(colours[segments.labels == label], axis=0).astype(int)) for label in (1, 2, 3)}
    assert middles == {cuboid.colour for cuboid in THREE}


def test_the_same_frame_gives_the_same_segments() -> None:
    first, second = found(FINE_CAMERA), found(FINE_CAMERA)
    np.testing.assert_array_equal(first.labels, second.labels)
    np.testing.assert_array_equal(first.planes, second.planes)


def test_without_depth_there_is_nothing() -> None:
    blank = np.zeros(CAMERA.shape, np.uint8)
    colour, depth = np.zeros((*CAMERA.shape, 3), np.uint8), np.zeros(CAMERA.shape, np.float32)
    segments = find_segments(colour, depth, blank, CAMERA, SegmentsSettings())
    assert (len(segments), len(segments.planes), segments.labels.any()) == (0, 0, False)


def test_planes_are_those_of_the_camera() -> None:
    segments = found(FINE_CAMERA)
    assert segments.planes[0] @ [0, 0, 0, 1] > 0, "the camera is above"
    assert transform_plane(np.array([0, 0, 1.0, 0]), invert(POSE)) @ segments.planes[0] > 0.9
