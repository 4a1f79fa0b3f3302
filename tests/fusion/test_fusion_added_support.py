"""Segments of somebody who knows no planes, as a learned segmenter does, in worlds that are not upright."""

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE, ROOM, THREE, look_at, orbit, view
from numpy.typing import NDArray
from voting_room import keyframe

from spot3d.boxes import iou_matrix_3d, moved
from spot3d.camera_pose import CameraPose
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.objects.keyframes import with_support
from spot3d.geometry.planes import transform_plane
from spot3d.trajectory import rotation_from_vector

FROM_ABOVE = look_at((0.0, -0.1, 1.3))


def fused_in(T_world_room: NDArray[np.float64]) -> Fusion:
    """Frames along an arc, each with perfect labels, and no plane."""
    fusion, rng = Fusion(COARSE), np.random.default_rng(0)
    for stamp, pose in enumerate(orbit(10)):
        seen, labels = view(pose, ROOM + THREE, rng), keyframe(pose).labels
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(T_world_room @ pose), stamp)
        heat, stands_on = np.full(len(THREE), 0.6, np.float32), np.full(len(THREE), -1, np.int8)
        assert fusion.observe(FrameSegments(labels, heat, np.zeros((0, 4)), stands_on, CAMERA), stamp)
    return fusion


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (-2.1, 0.4, 0.0)])
def test_boxes_are_upright_on_what_fusion_knows_to_support_them(turn: tuple[float, float, float]) -> None:
    T = np.eye(4)
    T[:3, :3] = rotation_from_vector(np.array(turn))
    fusion = fused_in(T)
    found = fusion.objects()
    assert found.up @ T[:3, 2] > 0.999
    iou = iou_matrix_3d([moved(thing.box(), T) for thing in THREE], [item.box for item in found.objects])
    assert iou.shape == (len(THREE), len(THREE))
    assert iou.max(axis=1).min() > 0.75
    (plane,) = fusion.supports.planes()
    assert plane[:3] @ T[:3, 2] > 0.999


@pytest.mark.parametrize("pose", [orbit(3)[1], FROM_ABOVE])
def test_what_stands_on_a_support_and_what_does_not(pose: NDArray[np.float64]) -> None:
    seen = keyframe(pose, supports=())
    plane = transform_plane(np.array((0.0, 0.0, 1.0, 0.0)), np.linalg.inv(pose))
    known = with_support(seen, plane)
    assert known.stands_on.tolist() == [0] * len(THREE)
    np.testing.assert_array_equal(known.planes, plane[None])
    far_above = with_support(seen, plane + np.array((0.0, 0.0, 0.0, 0.3)))
    assert far_above.stands_on.tolist() == [-1] * len(THREE)


def test_without_depth_nothing_is_known_to_stand() -> None:
    blind = keyframe(FROM_ABOVE, supports=())
    blind.depth.fill(0)
    assert with_support(blind, np.array((0.0, 0.0, 1.0, 0.0))).stands_on.tolist() == [-1] * len(THREE)
