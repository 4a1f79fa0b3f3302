"""Upright boxes (Eq. 16)."""

import cv2
import numpy as np
import pytest
from fusion_room import rotation_z
from scipy.spatial.transform import Rotation

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.geometry.upright import share_inside, upright_box, with_bottom
from spot3d.trajectory import rotation_to_z

UP = np.array([0.0, 0.0, 1.0])
TILTED = np.array([0.36, -0.48, 0.8])


def corners(centre: tuple[float, float, float], size: tuple[float, float, float], R: np.ndarray) -> np.ndarray:
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    return ((signs * size) @ R.T + centre).astype(np.float32)


@pytest.mark.parametrize(
    "up", [UP, -UP, TILTED, -TILTED, np.array([1.0, 0, 0]), np.array([0, np.sin(1e-6), -np.cos(1e-6)])]
)
def test_rotation_turns_up_into_z(up: np.ndarray) -> None:
    R = rotation_to_z(up)
    np.testing.assert_allclose(R @ up, [0, 0, 1], atol=1e-5)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-7)
    assert np.linalg.det(R) == pytest.approx(1)


@pytest.mark.parametrize("up", [UP, -UP, TILTED])
@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.2, -0.7])
def test_the_box_of_a_rotated_cuboid_is_exact(up: np.ndarray, yaw: float) -> None:
    R = rotation_to_z(up).T @ rotation_z(yaw)
    truth = Box3D(np.array([0.4, -0.2, 0.9]), np.array([0.3, 0.12, 0.2]), R)
    box = upright_box(corners((0.4, -0.2, 0.9), (0.3, 0.12, 0.2), R), up)
    np.testing.assert_allclose(box.rotation[:, 2], up, atol=1e-9)
    assert iou_matrix_3d([box], [truth])[0, 0] > 0.999


def test_a_sheet_with_two_corners_unseen_keeps_its_sides() -> None:
    """Its principal axes are a third of a right angle off, and its hull fills little of its rectangle."""
    outline = np.array([(-0.15, -0.13), (0.05, -0.13), (0.15, -0.03), (0.15, 0.13), (-0.05, 0.13), (-0.15, 0.03)])
    points = np.column_stack((outline, np.zeros(6))).astype(np.float32)
    box = upright_box(points, UP)
    np.testing.assert_allclose(np.sort(box.size), [0.0, 0.26, 0.30], atol=1e-4)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_points_have_a_flat_box(count: int) -> None:
    points = np.array([[1, 2, 3], [1.5, 2, 3], [2, 2, 3]], np.float32)[:count]
    box = upright_box(points, UP)
    assert box.volume == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(box.centre, points.mean(axis=0), atol=1e-6)


@pytest.mark.parametrize("trim", [0.0, 0.005, 0.1])
@pytest.mark.parametrize("count", [1, 2, 7, 300, 4000])
def test_boxes_are_those_of_all_points_and_plain_quantiles(count: int, trim: float) -> None:
    rng = np.random.default_rng(count)
    points = (rng.normal(0, [0.3, 0.1, 0.05], (count, 3)) @ rotation_z(0.4).T).astype(np.float32)
    points[count // 2 :] = np.clip(points[count // 2 :], -0.1, 0.1)  # corners, sides and points that coincide
    footprint = points[:, :2] - points[0, :2].astype(np.float64)
    yaw = np.deg2rad(cv2.minAreaRect(footprint.astype(np.float32))[2]) % (np.pi / 2)
    turned = points.astype(np.float64) @ rotation_z(yaw)
    low, high = np.quantile(turned, [trim, 1 - trim], axis=0)
    box = upright_box(points, UP, trim=trim)
    np.testing.assert_allclose(box.size, high - low, atol=1e-6)  # the reference has its yaw in single precision
    np.testing.assert_allclose(box.centre, rotation_z(yaw) @ ((low + high) / 2), atol=1e-6)


def test_without_points_there_is_no_box() -> None:
    with pytest.raises(ValueError, match="no points"):
        upright_box(np.zeros((0, 3), np.float32), UP)


@pytest.mark.parametrize(("height", "expected"), [(-0.1, 0.2), (0.0, 0.1), (0.06, 0.04), (0.5, 0.0)])
def test_a_new_bottom_leaves_the_top(height: float, expected: float) -> None:
    R = rotation_to_z(TILTED).T
    box = with_bottom(Box3D(0.07 * TILTED, np.array([0.1, 0.2, 0.06]), R), height)
    assert box.size[2] == pytest.approx(expected)
    assert TILTED @ box.centre + box.size[2] / 2 == pytest.approx(0.1)
    np.testing.assert_allclose(box.centre, (TILTED @ box.centre) * TILTED, atol=1e-12)


def test_share_inside_a_rotated_box() -> None:
    R = Rotation.from_rotvec([0.3, 0.4, 0.5]).as_matrix()
    box = Box3D(np.array([1.0, 2, 3]), np.array([0.2, 0.2, 0.2]), R)
    points = (np.array([[0, 0, 0], [0.09, 0, 0], [0.11, 0, 0], [0, 0, -0.3]]) @ R.T + box.centre).astype(np.float32)
    assert share_inside(points, box) == 0.5
    assert share_inside(points, box, margin=0.02) == 0.75
