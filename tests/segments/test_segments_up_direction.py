"""What is up stays up in the world, however the camera is rolled."""

import numpy as np
import pytest
from fusion_room import look_at
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.segments.up_direction import UpDirection

CAMERA = Intrinsics(100, 100, 1, 1, 2, 2)
WORLD_UP, WALL = np.array((0.0, 0.0, 1.0)), np.array((0.0, -1.0, 0.0))


def pose(turn: float) -> NDArray[np.float64]:
    """Looks down on a table, rolled by so many radians about its axis."""
    T = look_at((0, -0.95, 0.7))
    T[:3, :3] = T[:3, :3] @ np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]])
    return T


def after(*normals: NDArray[np.float64]) -> UpDirection:
    direction = UpDirection()
    for normal in normals:
        direction.learn(normal)
    return direction


@pytest.mark.parametrize("turn", [0.0, 0.5 * np.pi, np.pi])
def test_up_is_known_in_a_camera_that_is_rolled(turn: float) -> None:
    up = after(*[WORLD_UP] * 5).in_camera(pose(turn))
    assert up is not None
    np.testing.assert_allclose(pose(turn)[:3, :3] @ up, WORLD_UP, atol=1e-9)


def test_few_keyframes_say_nothing() -> None:
    assert UpDirection().in_camera(pose(0)) is None
    assert after(*[WORLD_UP] * 4).in_camera(pose(0)) is None


@pytest.mark.parametrize(
    "normals",
    [
        (WALL, WORLD_UP, WORLD_UP, WALL, WORLD_UP, WORLD_UP),  # a wall or two do not matter
        (*[WALL] * 10, *[WORLD_UP] * 25),  # a wrong start is outvoted
        (*[WALL] * 60, *[WORLD_UP] * 30),  # what was up long ago is forgotten
    ],
)
def test_most_of_the_last_keyframes_decide(normals: tuple[NDArray[np.float64], ...]) -> None:
    up = after(*normals).in_camera(pose(0))
    assert up is not None
    np.testing.assert_allclose(pose(0)[:3, :3] @ up, WORLD_UP, atol=1e-9)


def test_without_a_majority_nothing_is_known() -> None:
    assert after(*[WALL, WORLD_UP] * 5).in_camera(pose(0)) is None
