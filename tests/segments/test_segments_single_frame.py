"""Objects of one frame: parts that hang, parts that something hides from each other."""

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, Cuboid, look_at, standing, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.fusion.settings import FusionSettings
from spot3d.segments.hanging import join_hanging
from spot3d.segments.single_frame import find_in_frame

UP = np.array([0.0, -1.0, 0.0])
Patch = tuple[int, int, int, int, float]
"""Left, top, width, height in pixels, and depth in metres."""
MUG: Patch = (40, 40, 20, 40, 1.0)


def hung(*patches: Patch, up: NDArray[np.float64] = UP) -> list[list[int]]:
    """Which upright patches before a wall at 1.5 m are joined, by number."""
    depth, owner = np.full(CAMERA.shape, 1.5, np.float32), np.full(CAMERA.shape, -1)
    for number, (left, top, width, height, distance) in enumerate(patches):
        where = np.s_[top : top + height, left : left + width]
        depth[where], owner[where] = distance, number
    clusters = [np.flatnonzero(owner.ravel() == number) for number in range(len(patches))]
    found = join_hanging(clusters, back_project(depth, CAMERA), up)
    return sorted(sorted(set(owner.ravel()[pixels].tolist())) for pixels in found)


def test_a_handle_hangs_on_its_mug() -> None:
    assert hung(MUG, (60, 50, 6, 20, 1.0)) == [[0, 1]]


def test_down_is_where_the_plane_says() -> None:
    lying_camera = np.array([-1.0, 0.0, 0.0])  # the image's right is down: the handle stands on the mug
    beneath = (20, 50, 20, 20, 1.0)
    assert hung(MUG, beneath, up=lying_camera) == [[0], [1]]
    assert hung(MUG, (45, 80, 6, 10, 1.0), up=lying_camera) == [[0, 1]]


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("stands on it", (45, 30, 10, 10, 1.0)),
        ("stands beside it on something", (60, 100, 10, 20, 1.0)),
        ("hangs behind it", (60, 50, 6, 20, 1.1)),
        ("is as large", (60, 30, 20, 40, 1.0)),
    ],
)
def test_what_does_not_hang_stays_apart(name: str, other: Patch) -> None:
    assert hung(MUG, other) == [[0], [1]], name


FINE_CAMERA = Intrinsics(450.0, 450.0, 239.5, 179.5, 480, 360)

POLE = standing(0.0, -0.25, (0.04, 0.04, 0.3))


def found(*things: Cuboid) -> int:
    """Objects in a frame that looks at things on the table."""
    pose = look_at((0, -1.0, 0.35))
    seen = view(pose, (*ROOM, *things), np.random.default_rng(0), FINE_CAMERA)
    return len(find_in_frame(seen.colour, seen.depth, seen.heat, FINE_CAMERA, FusionSettings()).boxes)


def test_a_box_that_a_pole_divides_is_one() -> None:
    assert found(standing(0.0, 0.0, (0.24, 0.08, 0.14)), POLE) == 2


@pytest.mark.parametrize(
    ("name", "left", "right"),
    [
        ("of other height", standing(-0.083, 0.0, (0.12, 0.08, 0.14)), standing(0.083, 0.0, (0.12, 0.08, 0.2))),
        ("one behind the other", standing(-0.083, 0.0, (0.12, 0.08, 0.14)), standing(0.083, 0.06, (0.12, 0.08, 0.14))),
    ],
)
def test_two_boxes_beside_a_pole_are_two(name: str, left: Cuboid, right: Cuboid) -> None:
    assert found(left, right, POLE) == 3, name


def test_of_two_boxes_far_apart_too_little_is_seen_to_be_one() -> None:
    screen = standing(0.0, -0.2, (0.36, 0.02, 0.25))
    boxes = (standing(-0.22, 0.0, (0.06, 0.08, 0.14)), standing(0.22, 0.0, (0.06, 0.08, 0.14)))
    assert found(*boxes, screen) == 3
