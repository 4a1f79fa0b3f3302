"""A camera that is mounted with another side up than the settings say is found out, and one that is not never is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.segments.upper_side import IMAGE_UP, UpperSide

SIDES = ("top", "right", "bottom", "left")
"""Each a quarter turn, clockwise, after the one before."""
FEWEST, REMEMBERED = 20, 30


def facing(elevation: float, roll: float = 0.0, azimuth: float = 0.0) -> NDArray[np.float64]:
    """(4,) plane whose normal points up in the image by so many degrees: of a table 90 where the camera looks level.

    roll: of the camera; azimuth: by how much the normal points aside, degrees.
    """
    up, aside, roll = np.radians(elevation), np.radians(azimuth), np.radians(roll)
    x, y, z = np.cos(up) * np.sin(aside), -np.sin(up), -np.cos(up) * np.cos(aside)
    return np.array((np.cos(roll) * x - np.sin(roll) * y, np.sin(roll) * x + np.cos(roll) * y, z, 1.0))


TABLE, CEILING = facing(50), facing(-50)
WALL = facing(-30, azimuth=45)
"""The wall of a room whose corner a camera looks at that looks down by 30 degrees or more."""


def turned(planes: NDArray[np.float64], side: str) -> NDArray[np.float64]:
    """The same planes seen by a camera whose image has this side up."""
    quarter = np.array([[0, 1.0, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return np.asarray(planes @ np.linalg.matrix_power(quarter, SIDES.index(side)))


def after(count: int, *planes: NDArray[np.float64], side: str = "top", image_up: str = "top") -> UpperSide:
    """After so many keyframes of planes, each of which holds half as much heat as the one before."""
    upper = UpperSide(image_up)
    for _ in range(count):
        upper.learn(turned(np.array(planes).reshape(-1, 4), side), 1000 * 0.5 ** np.arange(len(planes)), None)
    return upper


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("image_up", SIDES)
def test_the_side_that_is_up_is_found_where_the_settings_name_another(side: str, image_up: str) -> None:
    assert turned(TABLE, side)[:3] @ IMAGE_UP[side] == pytest.approx(TABLE[:3] @ IMAGE_UP["top"])
    assert after(FEWEST - 1, TABLE, side=side, image_up=image_up).found == ""
    found = after(FEWEST, WALL, TABLE, side=side, image_up=image_up).found
    assert found == ("" if side == image_up else side)


@pytest.mark.parametrize(
    "plane",
    [WALL, facing(15), facing(50, roll=15), facing(50, roll=75)],
    ids=["a wall", "a table from above", "rolled", "rolled far"],
)
@pytest.mark.parametrize("image_up", SIDES)
def test_what_may_be_no_table_says_nothing(plane: NDArray[np.float64], image_up: str) -> None:
    assert after(REMEMBERED, plane, image_up=image_up).found == ""


def test_a_camera_that_looks_down_at_a_table_is_not_doubted_for_the_fronts_of_things_on_it() -> None:
    """These face the lower side of the image, as a table does in a camera that hangs upside down."""
    assert after(REMEMBERED, facing(12), facing(12 - 90)).found == ""


@pytest.mark.parametrize("planes", [np.zeros((0, 4)), CEILING[None]], ids=["no plane", "a cold plane"])
def test_keyframes_without_a_hot_plane_say_nothing(planes: NDArray[np.float64]) -> None:
    upper = UpperSide("top")
    for _ in range(REMEMBERED):
        upper.learn(planes, np.zeros(len(planes)), None)
    assert upper.found == ""


@pytest.mark.parametrize(("others", "found"), [(4, "left"), (5, "")])
def test_most_keyframes_have_to_agree(others: int, found: str) -> None:
    """Of twenty; whether the others see a table as the settings have it, or nothing at all."""
    for other in (np.array([TABLE]), np.zeros((0, 4))):
        upper = UpperSide("top")
        for number in range(FEWEST):
            planes = other if number < others else turned(np.array([TABLE]), "left")
            upper.learn(planes, np.ones(len(planes)), None)
        assert upper.found == found


def test_a_side_once_found_stays() -> None:
    upper = after(FEWEST, TABLE, side="right")
    for side in ("top", "bottom"):
        for _ in range(REMEMBERED):
            upper.learn(turned(np.array([TABLE]), side), np.ones(1), None)
    assert upper.found == "right"


@pytest.mark.parametrize(("off", "found"), [(0, ""), (10, ""), (20, "bottom")])
def test_a_camera_that_is_known_to_be_rolled_is_mounted_as_it_is_said_to_be(off: float, found: str) -> None:
    """What is known to be up, `off` degrees from what things stand on, is up wherever it is in the image."""
    upper, up = UpperSide("top"), turned(facing(50 + off), "bottom")[:3]
    for _ in range(REMEMBERED):
        upper.learn(turned(np.array([TABLE]), "bottom"), np.ones(1), up)
    assert upper.found == found
