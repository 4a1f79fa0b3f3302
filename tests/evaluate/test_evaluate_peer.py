"""Plane + DBSCAN on a made-up table, and what the tables say of it."""

from math import nan

import numpy as np
import pytest
from table_frame import BLOCKS, CAMERA, T_WORLD_CAMERA, table_depth

from spot3d.boxes import Box3D, iou_matrix_2d, iou_matrix_3d
from spot3d.evaluate.dominant_plane import dominant_plane
from spot3d.evaluate.labelled import mask_boxes
from spot3d.evaluate.peer import behind_peer, dbscan_clusters, peer_in_frame, voxel_means
from spot3d.evaluate.peer_map import FRAMES_MAX, PeerMap
from spot3d.fusion.settings import FusionSettings

SIZE_MAX = FusionSettings().size_max


def test_the_dominant_plane_is_the_one_with_most_points() -> None:
    rng = np.random.default_rng(5)
    table = np.column_stack((rng.uniform(-1, 1, (600, 2)), np.full(600, 2.0)))
    wall = np.column_stack((np.full(400, 1.0), rng.uniform(-1, 1, (400, 2))))
    for shift in (0.0, 50.0):
        xyz = np.concatenate((wall, table)) + shift
        plane = dominant_plane(xyz, np.full(3, shift))
        np.testing.assert_allclose(plane, [0, 0, -1, 2 + shift], atol=1e-6)
        np.testing.assert_array_equal(plane, dominant_plane(xyz, np.full(3, shift)))
        np.testing.assert_array_equal(-plane, dominant_plane(xyz, np.full(3, shift + 5)), "seen from the other side")


@pytest.mark.parametrize("points", [np.zeros((3, 3)), np.arange(9.0).reshape(3, 3)])
def test_points_without_a_plane_give_one_all_the_same(points: np.ndarray) -> None:
    plane = dominant_plane(points, np.zeros(3))
    assert np.isfinite(plane).all()
    assert np.linalg.norm(plane[:3]) == pytest.approx(1)


def test_peer_boxes_what_stands_on_a_table() -> None:
    depth, shown = table_depth()
    depth += np.random.default_rng(1).normal(0, 0.002, depth.shape).astype(np.float32)
    found = peer_in_frame(depth, CAMERA, SIZE_MAX)
    assert len(found) == len(BLOCKS)
    assert iou_matrix_2d(mask_boxes(shown, 2), found).max(axis=1).min() > 0.7
    np.testing.assert_array_equal(found, peer_in_frame(depth, CAMERA, SIZE_MAX))


@pytest.mark.parametrize("blocks", [(), BLOCKS])
def test_peer_finds_nothing_where_nothing_is(blocks: tuple) -> None:
    depth, shown = table_depth(blocks)
    depth[shown > 1] = 0
    assert peer_in_frame(depth, CAMERA, SIZE_MAX).shape == (0, 4)
    assert peer_in_frame(np.zeros_like(depth), CAMERA, SIZE_MAX).shape == (0, 4)
    assert T_WORLD_CAMERA[2, 3] == 0.8


def test_peer_has_the_limits_of_range_and_size_in_a_frame() -> None:
    """Things are left out where they are all beyond 2.5 m, and a wall of 1.2 m behind the blocks always."""
    depth, _ = table_depth()
    assert len(peer_in_frame(2 * depth, CAMERA, SIZE_MAX)) == len(BLOCKS)
    assert len(peer_in_frame(3 * depth, CAMERA, SIZE_MAX)) == 0
    walled, _ = table_depth((*BLOCKS, ((-0.6, 0.3, 0.0), (0.6, 0.4, 0.2))))
    assert len(peer_in_frame(walled, CAMERA, SIZE_MAX)) == len(BLOCKS)
    assert len(peer_in_frame(walled, CAMERA, 1.3)) == len(BLOCKS) + 1


def test_voxel_means_are_of_each_voxels_points() -> None:
    points = np.array([[0.001, 0, 0], [0.011, 0, 0], [0.003, 0, 0], [-0.001, 0, 0]])
    means, voxel = voxel_means(points, 0.01)
    np.testing.assert_allclose(means[voxel], [[0.002, 0, 0], [0.011, 0, 0], [0.002, 0, 0], [-0.001, 0, 0]], atol=1e-12)
    assert len(means) == 3
    assert voxel_means(np.zeros((0, 3)), 0.01)[0].shape == (0, 3)
    assert dbscan_clusters(np.zeros((0, 3)), 1) == []


@pytest.mark.parametrize(
    ("ours", "theirs", "said"),
    [
        (0.9, 0.8, []),
        (0.804, 0.8, []),
        (0.796, 0.8, []),
        (0.5, 0.8, ["Behind plane + DBSCAN in success (0.50, it 0.80) on desk."]),
        (nan, 0.1, ["Behind plane + DBSCAN in success (-, it 0.10) on desk."]),
        (nan, 0.0, []),
        (0.1, nan, []),
    ],
)
def test_who_is_behind_is_told(ours: float, theirs: float, said: list[str]) -> None:
    assert behind_peer("desk", [("success", ours, theirs), ("detection", 1, 1)]) == said


def test_all_that_is_behind_is_told_at_once() -> None:
    (said,) = behind_peer("desk", [("success", 0.1, 0.2), ("detection", 0.3, 0.4)])
    assert said == "Behind plane + DBSCAN in success (0.10, it 0.20), detection (0.30, it 0.40) on desk."


def test_peer_boxes_what_stands_in_the_cloud_of_all_frames() -> None:
    """Noisy frames of a table from both sides: boxes around what stands on it, upright, in the run's world."""
    rng, frames = np.random.default_rng(3), 12
    peer = PeerMap(frames)
    for number in range(frames):
        pose = T_WORLD_CAMERA.copy()
        pose[0, 3] += 0.03 * (number - frames / 2)
        depth, _ = table_depth(BLOCKS, pose)
        depth += rng.normal(0, 0.002, depth.shape).astype(np.float32)
        peer.add(depth, CAMERA, pose)
    found = peer.found(FusionSettings())
    true = [Box3D((np.array(a) + b) / 2, np.subtract(b, a), np.eye(3)) for a, b in BLOCKS]
    assert len(found.boxes) == len(found.points) == len(true)
    # The camera sees no backs: what it shows of a block is 1 cm above the table and ends before its far side.
    assert iou_matrix_3d(true, found.boxes).max(axis=1).min() > 0.5
    for box in found.boxes:
        assert box.rotation[2, 2] == pytest.approx(1, abs=1e-3)
    assert peer.found(FusionSettings(size_max=0.05)).boxes == ()


def test_peer_takes_some_of_many_frames_and_what_they_see_often() -> None:
    many, depth = PeerMap(10 * FRAMES_MAX), table_depth()[0]
    for _ in range(11):
        many.add(depth, CAMERA, T_WORLD_CAMERA)
    assert many.frames_taken == 2
    assert PeerMap(3).found(FusionSettings()).boxes == ()
    blinking = PeerMap(20)
    for number in range(20):
        blinking.add(depth if number == 0 else table_depth(())[0], CAMERA, T_WORLD_CAMERA)
    assert len(blinking.found(FusionSettings(frequency_share=0.2)).boxes) == 0
    assert len(blinking.found(FusionSettings(frequency_min=1)).boxes) == len(BLOCKS)
