"""Dominant planes by RANSAC, and their transforms."""

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, look_at, view

from spot3d.camera import back_project, invert
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.planes import (
    dominant_planes,
    fit_plane,
    on_plane,
    refine_plane,
    transform_plane,
)

SETTINGS = FusionSettings()
POSE = look_at((0.9, -1.3, 0.8), (0.3, 0.5, -0.15))  # sees table, floor and wall
TABLE_WORLD, FLOOR_WORLD = np.array([0, 0, 1.0, 0]), np.array([0, 0, 1.0, 0.75])
WALL_WORLD = np.array([0, -1.0, 0, 1.5])


def room_points(seed: int = 0) -> np.ndarray:
    return back_project(view(POSE, ROOM, np.random.default_rng(seed)).depth, CAMERA)


def same_plane(a: np.ndarray, b: np.ndarray) -> bool:
    """Within 10 degrees, and 4 cm at the camera's distance."""
    return bool(a[:3] @ b[:3] > np.cos(np.deg2rad(10)) and abs(a[3] - b[3]) < 0.04)


def in_camera(plane: np.ndarray) -> np.ndarray:
    return transform_plane(plane, invert(POSE))


@pytest.mark.parametrize("seed", range(3))
def test_floor_table_and_wall_are_found_most_inliers_first(seed: int) -> None:
    points = room_points(seed)
    planes = dominant_planes(points, SETTINGS, np.random.default_rng(seed))
    counts = [int(on_plane(plane, points, SETTINGS).sum()) for plane in planes]
    assert len(planes) == 3
    assert counts == sorted(counts, reverse=True)
    assert (planes[:, 3] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1, atol=1e-9)
    for truth in map(in_camera, (TABLE_WORLD, FLOOR_WORLD, WALL_WORLD)):
        assert sum(same_plane(truth, plane) for plane in planes) == 1
        best = planes[np.argmax(planes[:, :3] @ truth[:3] - np.abs(planes[:, 3] - truth[3]))]
        assert best[:3] @ truth[:3] > np.cos(np.deg2rad(2))
        assert abs(best[3] - truth[3]) < 0.03


def test_no_more_planes_than_asked() -> None:
    settings = FusionSettings(plane_candidates=2)
    assert len(dominant_planes(room_points(), settings, np.random.default_rng(0))) == 2


@pytest.mark.parametrize(
    ("name", "depth"),
    [
        ("nothing", np.zeros(CAMERA.shape)),
        ("too little", np.pad(np.ones((5, 5)), ((0, 115), (0, 155)))),
        ("not a number", np.full(CAMERA.shape, np.nan)),
        ("a single line", np.pad(np.ones((1, 160)), ((50, 69), (0, 0)))),
    ],
)
def test_where_there_is_no_plane(name: str, depth: np.ndarray) -> None:
    points = back_project(depth.astype(np.float32), CAMERA)
    assert dominant_planes(points, SETTINGS, np.random.default_rng(0)).shape == (0, 4), name


def test_known_planes_are_found_with_few_triples() -> None:
    few = FusionSettings(plane_triples=10)
    known = np.array([in_camera(plane) for plane in (TABLE_WORLD, FLOOR_WORLD, WALL_WORLD)])
    planes = dominant_planes(room_points(), few, np.random.default_rng(0), known)
    assert all(any(same_plane(plane, truth) for plane in planes) for truth in known)


def test_what_has_no_depth_lies_on_no_plane() -> None:
    points = np.array([[[0, 0, 0], [0.1, 0, 1]]], np.float32)  # a plane through the camera, where z = 0 is
    np.testing.assert_array_equal(on_plane(np.array([0, 1.0, 0, 0]), points, SETTINGS), [[False, True]])


def test_a_point_keeps_its_distance_when_its_plane_is_transformed() -> None:
    rng = np.random.default_rng(3)
    plane = np.append(np.array([0.6, 0.0, 0.8]), -0.4)
    points = rng.normal(size=(20, 3))
    moved = points @ POSE[:3, :3].T + POSE[:3, 3]
    there = transform_plane(plane, POSE)
    np.testing.assert_allclose(moved @ there[:3] + there[3], points @ plane[:3] + plane[3], atol=1e-12)


def test_refining_leaves_out_what_is_off_the_plane() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (2000, 3)).astype(np.float32)
    points[:, 2] = 1 + rng.normal(0, 0.001, 2000)
    points[:600, 2] += rng.uniform(0.05, 0.5, 600)
    rough = np.array([0.004, -0.003, -1.0, 1.002])
    refined = refine_plane(rough / np.linalg.norm(rough[:3]), points, np.full(2000, 0.01, np.float32))
    np.testing.assert_allclose(refined, [0, 0, -1, 1], atol=3e-4)


def test_points_refine_a_plane_by_the_inverse_of_their_variance() -> None:
    points = np.random.default_rng(6).uniform(-1, 1, (2000, 3)).astype(np.float32)
    noisy = np.arange(2000) % 2 == 0
    points[:, 2] = np.where(noisy, 1.01, 1.0)
    refined = refine_plane(np.array([0, 0, -1.0, 1.0]), points, np.where(noisy, 0.02, 0.002).astype(np.float32))
    np.testing.assert_allclose(refined, [0, 0, -1, 1.0001], atol=2e-5)


def test_refining_without_inliers_changes_nothing() -> None:
    plane = np.array([0, 0, -1.0, 5.0])
    points = np.ones((10, 3), np.float32)
    np.testing.assert_array_equal(refine_plane(plane, points, np.full(10, 0.01, np.float32)), plane)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_fitted_normal_points_the_asked_way(side: float) -> None:
    points = np.random.default_rng(5).uniform(-1, 1, (50, 3)).astype(np.float32)
    points[:, 1] = 0.25
    plane = fit_plane(points, np.ones(50, np.float32), np.array([0, side, 0]))
    np.testing.assert_allclose(plane, [0, side, 0, -side * 0.25], atol=1e-7)
