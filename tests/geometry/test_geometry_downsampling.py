"""A frame on its lattice: means of the nearest surface, and intrinsics that still fit."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics, back_project
from spot3d.geometry.downsampling import block_size, to_lattice


def camera(width: int, height: int) -> Intrinsics:
    return Intrinsics(300.0, 310.0, width / 2 - 3.3, height / 2 + 1.7, width, height)


def blank(camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((*camera.shape, 3), np.uint8), np.zeros(camera.shape, np.uint8)


def plane_depth(camera: Intrinsics, plane: np.ndarray) -> np.ndarray:
    rays = back_project(np.ones(camera.shape, np.float32), camera).astype(np.float64)
    return (-plane[3] / (rays @ plane[:3])).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "size", "focal", "pixels"),
    [
        ("Kinect, Orbbec", (640, 480), 525.0, 2),
        ("7-Scenes", (640, 480), 585.0, 2),
        ("half of it", (320, 240), 262.5, 1),
        ("RealSense's colour", (848, 480), 610.0, 2),
        ("RealSense's colour", (1280, 720), 915.0, 3),
        ("the same, upright", (720, 1280), 915.0, 3),
        ("RealSense's depth, 90 degrees across", (848, 480), 424.0, 2),
        ("OAK-D", (640, 400), 450.0, 2),
        ("Azure Kinect's colour", (1280, 720), 610.0, 3),
        ("a narrow view", (640, 480), 1200.0, 2),
        ("four times VGA", (1920, 1080), 1050.0, 4),
    ],
)
def test_samples_are_as_many_to_the_radian_as_a_kinects(
    name: str, size: tuple[int, int], focal: float, pixels: int
) -> None:
    camera = Intrinsics(focal, focal, size[0] / 2, size[1] / 2, *size)
    assert block_size(camera, 320) == pixels, name
    assert max(size) / pixels <= 480, "a wide camera's samples are limited"


@pytest.mark.parametrize(("width", "factor"), [(640, 1), (320, 1), (160, 2), (107, 3), (80, 4)])
def test_a_plane_stays_on_its_plane(width: int, factor: int) -> None:
    full = camera(320, 240)
    normal = np.array([0.3, -0.5, -0.8]) / np.linalg.norm([0.3, -0.5, -0.8])
    plane = np.append(normal, 1.2)
    frame = to_lattice(blank(full)[0], plane_depth(full, plane), blank(full)[1], full, width)
    assert frame.depth.shape == frame.camera.shape == (240 // factor, -(-320 // factor))
    rows = slice(None, 320 // factor)  # a block cut by the image's border has its middle elsewhere
    points = back_project(frame.depth, frame.camera)[:, rows]
    assert np.abs(points @ plane[:3] + plane[3]).max() < 2e-4


def test_factor_one_changes_nothing() -> None:
    full = camera(40, 30)
    rng = np.random.default_rng(1)
    colour = rng.integers(0, 256, (30, 40, 3), np.uint8)
    depth = rng.uniform(0.5, 3, (30, 40)).astype(np.float32)
    heat = rng.integers(0, 256, (30, 40), np.uint8)
    frame = to_lattice(colour, depth, heat, full, 40, grazing_cos=0)
    assert frame.camera == full
    for given, got in ((colour, frame.colour), (depth, frame.depth), (heat, frame.heat)):
        np.testing.assert_array_equal(got, given)


@pytest.mark.parametrize(
    ("name", "block", "expected"),
    [
        ("nothing valid", [[0, 0], [0, 0]], 0.0),
        ("one valid", [[0, 1.5], [0, 0]], 1.5),
        ("one surface", [[1.0, 1.002], [1.004, 1.002]], 1.002),
        ("two surfaces: the nearer", [[1.0, 2.0], [2.0, 1.002]], 1.001),
        ("two surfaces, 5 cm apart", [[1.0, 1.05], [1.05, 1.002]], 1.001),
        ("not a number is not valid", [[np.nan, 1.0], [1.0, np.inf]], 1.0),
    ],
)
def test_depth_is_the_mean_of_the_nearest_surface(name: str, block: list[list[float]], expected: float) -> None:
    tiny = Intrinsics(2.0, 2.0, 0.5, 0.5, 2, 2)
    depth = np.array(block, np.float32)
    assert to_lattice(*blank(tiny)[:1], depth, blank(tiny)[1], tiny, 1).depth == pytest.approx(expected), name


@pytest.mark.parametrize("width", [40, 20])
def test_read_only_and_strided_frames_are_taken(width: int) -> None:
    full = camera(40, 30)
    depth = np.asfortranarray(np.ones((30, 40), np.float32))
    colour, heat = blank(full)
    for array in (depth, colour, heat):
        array.setflags(write=False)
    frame = to_lattice(colour, depth, heat, full, width)
    assert all(a.flags.c_contiguous and a.flags.writeable for a in (frame.colour, frame.depth, frame.heat))
