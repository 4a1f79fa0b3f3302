"""Normals from depth: right on planes, towards the camera, none where the surface breaks."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics, back_project
from spot3d.geometry.normals import surface_normals

CAMERA = Intrinsics(150.0, 150.0, 39.5, 29.5, 80, 60)


def depth_of(normal: np.ndarray, distance: float) -> np.ndarray:
    rays = back_project(np.ones(CAMERA.shape, np.float32), CAMERA)
    return (-distance / (rays @ normal)).astype(np.float32)


@pytest.mark.parametrize("tilt", [0, 20, 45, 65])
@pytest.mark.parametrize("about", [0.0, 1.0, 2.5, 4.0])
def test_planes_at_every_tilt(tilt: float, about: float) -> None:
    angle = np.deg2rad(tilt)
    normal = np.array([np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about), -np.cos(angle)])
    found = surface_normals(depth_of(normal, np.cos(angle)), CAMERA)
    degrees = np.rad2deg(np.arccos(np.clip(found @ normal, -1, 1)))
    assert degrees.max() < 2.0


def test_they_face_the_camera() -> None:
    depth = depth_of(np.array([0.6, 0.0, -0.8]), 1.0)
    towards = np.einsum("ijk,ijk->ij", surface_normals(depth, CAMERA), back_project(depth, CAMERA))
    assert (towards < 0).all()


def test_no_difference_reaches_over_a_jump() -> None:
    depth = np.full(CAMERA.shape, 1.0, np.float32)
    depth[:, 40:] = 2.0
    np.testing.assert_allclose(surface_normals(depth, CAMERA)[..., 2], -1, atol=1e-6)


@pytest.mark.parametrize("value", [0.0, np.nan, -1.0])
def test_what_is_invalid_or_alone_has_none(value: float) -> None:
    depth = np.full(CAMERA.shape, value, np.float32)
    depth[20, 20] = 1.0
    depth[40, 2:70:2] = 1.5
    assert not surface_normals(depth, CAMERA).any()
