"""Registration of colour to depth against a slow reference and a made-up view."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics, back_project
from spot3d.source.calibration import ColourCamera
from spot3d.source.colour_registration import ColourRegistration
from spot3d.source.errors import SourceError

DEPTH_CAMERA = Intrinsics(100.0, 100.0, 40.0, 30.0, 80, 60)
RNG = np.random.default_rng(5)


def colour_camera(x: float = -0.05, focal: float = 90.0) -> ColourCamera:
    T_colour_depth = np.eye(4)
    T_colour_depth[:3, 3] = (x, 0.004, -0.002)
    return ColourCamera(Intrinsics(focal, focal, 41.0, 29.0, 80, 60), T_colour_depth)


def ramp_image() -> np.ndarray:
    v, u = np.mgrid[:60, :80]
    return np.stack((3 * u, 4 * v, u + v), axis=-1).astype(np.uint8)


def reference(colour: np.ndarray, depth: np.ndarray, camera: ColourCamera) -> np.ndarray:
    """Nearest-pixel look-up of every measured point, without occlusion; (-1) where there is none."""
    points = back_project(depth, DEPTH_CAMERA).reshape(-1, 3) @ camera.T_colour_depth[:3, :3].T
    points += camera.T_colour_depth[:3, 3]
    k = camera.intrinsics
    z = np.where(depth.ravel() > 0, points[:, 2], 1)
    u, v = k.fx * points[:, 0] / z + k.cx, k.fy * points[:, 1] / z + k.cy
    inside = (depth.ravel() > 0) & (u >= 0) & (u <= k.width - 1) & (v >= 0) & (v <= k.height - 1)
    out = np.full((depth.size, 3), -1)
    out[inside] = colour[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    return out.reshape(*depth.shape, 3)


def test_smooth_surface_agrees_with_the_reference() -> None:
    v, u = np.mgrid[:60, :80]
    depth = (1.0 + 0.002 * u + 0.003 * v + RNG.normal(0, 0.001, u.shape)).astype(np.float32)
    colour = ramp_image()
    found = ColourRegistration(DEPTH_CAMERA, colour_camera()).register(colour, depth)
    expected = reference(colour, depth, colour_camera())
    known = expected[..., 0] >= 0
    assert known.mean() > 0.8
    # The reference rounds to whole pixels, the ramps' steps are 3 and 4 levels.
    assert np.abs(found.astype(int) - expected)[known].max() <= 3


def test_same_camera_gives_the_same_image() -> None:
    camera = ColourCamera(DEPTH_CAMERA, np.eye(4))
    colour = RNG.integers(0, 256, (60, 80, 3)).astype(np.uint8)
    depth = RNG.uniform(0.5, 3, (60, 80)).astype(np.float32)
    depth[RNG.random((60, 80)) < 0.2] = 0
    found = ColourRegistration(DEPTH_CAMERA, camera).register(colour, depth)
    assert np.abs(found.astype(int) - colour).max() <= 4, "remapping works in 32nds of a pixel"


def view_of_two_planes() -> tuple[np.ndarray, np.ndarray]:
    """Red wall at 2 m behind a green board at 0.5 m, exact in both cameras' images."""
    x_from, x_to = -0.05, 0.05
    images = []
    for camera, shift in ((DEPTH_CAMERA, 0.0), (colour_camera().intrinsics, -0.05)):
        u = np.arange(camera.width)
        left, right = ((x + shift) / 0.5 * camera.fx + camera.cx for x in (x_from, x_to))
        images.append(np.tile((u >= left) & (u <= right), (camera.height, 1)))
    depth = np.where(images[0], 0.5, 2.0).astype(np.float32)
    colour = np.zeros((60, 80, 3), np.uint8)
    colour[images[1]] = (0, 255, 0)
    colour[~images[1]] = (255, 0, 0)
    return depth, colour


def test_hidden_wall_does_not_take_the_boards_colour() -> None:
    depth, colour = view_of_two_planes()
    T_colour_depth = np.eye(4)
    T_colour_depth[0, 3] = -0.05
    camera = ColourCamera(colour_camera().intrinsics, T_colour_depth)
    naive = reference(colour, depth, camera)
    wall = depth > 1
    assert ((naive[..., 1] > 128) & wall).sum() > 100, "the plain look-up copies the board onto the wall"
    found = ColourRegistration(DEPTH_CAMERA, camera).register(colour, depth)
    # One column on each side may mix at the border.
    inner_wall = wall & ~(np.roll(~wall, 1, axis=1) | np.roll(~wall, -1, axis=1))
    assert (found[inner_wall][:, 0] > 128).all()
    board = ~wall & np.roll(~wall, 1, axis=1) & np.roll(~wall, -1, axis=1)
    assert (found[board][:, 1] > 128).all()


@pytest.mark.parametrize("hole", [np.s_[:, 10:20], np.s_[0:10], np.s_[50:], np.s_[:, :], np.s_[20:25, 30:]])
def test_holes_in_depth_leave_no_holes_in_colour(hole: tuple[slice, ...]) -> None:
    depth = np.full((60, 80), 1.5, np.float32)
    depth[hole] = 0
    colour = np.full((60, 80, 3), 180, np.uint8)
    assert (ColourRegistration(DEPTH_CAMERA, colour_camera()).register(colour, depth) == 180).all()


def test_finer_colour_camera_leaves_no_gaps_in_its_depth_buffer() -> None:
    fine = ColourCamera(Intrinsics(250.0, 250.0, 110.0, 80.0, 220, 160), colour_camera().T_colour_depth)
    depth, _ = view_of_two_planes()
    registration = ColourRegistration(DEPTH_CAMERA, fine)
    registration.register(np.zeros((160, 220, 3), np.uint8), depth)
    hidden = registration._is_hidden[5:-5]
    # 10 cm of wall behind a board of 10 cm at a quarter of its distance, seen 5 cm from the side: 7.5 px.
    assert hidden.any(axis=0).sum() == pytest.approx(7.5, abs=2)
    assert (hidden.any(axis=0) == hidden.all(axis=0)).all()


def test_depth_whose_inverse_is_infinite_stays_within_the_colour_image() -> None:
    camera = ColourCamera(colour_camera().intrinsics, np.eye(4) + 1e-3 * np.eye(4, k=3))
    depth = np.full((60, 80), 1e-40, np.float32)
    registration = ColourRegistration(DEPTH_CAMERA, camera)
    registration.register(ramp_image(), depth)
    column, row = registration._column, registration._row
    assert ((column >= 0) & (column <= 79) & (row >= 0) & (row <= 59)).all()


def test_wrong_size_is_refused() -> None:
    with pytest.raises(SourceError, match="size mismatch"):
        ColourRegistration(DEPTH_CAMERA, colour_camera()).register(
            np.zeros((60, 81, 3), np.uint8), np.zeros((60, 80), np.float32)
        )
