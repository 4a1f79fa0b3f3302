"""The parts of one object left and right of something in front of it are one."""

import numpy as np
import pytest
from fusion_room import ROOM, Cuboid, look_at, standing, view
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project, invert
from spot3d.geometry.normals import surface_normals
from spot3d.segments.occlusion import join_occluded

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
POSE = look_at((0.0, -0.9, 0.35), (0, 0, 0.08))
UP = invert(POSE)[:3, :3] @ (0, 0, 1.0)
RED, GREEN, BLUE = (200, 40, 40), (40, 160, 60), (50, 60, 200)
CARTON = standing(0, 0.1, (0.3, 0.08, 0.16), colour=RED)
POST = standing(0, -0.15, (0.05, 0.05, 0.24), colour=GREEN)


def parts_of(*things: Cuboid, noise: bool = False) -> list[list[tuple[int, int]]]:
    """What is joined: of each cluster the parts in it, as (thing, 0 = left or 1 = right of the image's middle)."""
    seen = view(POSE, ROOM + things, np.random.default_rng(0) if noise else None, CAMERA)
    points = back_project(seen.depth, CAMERA)
    right = np.arange(CAMERA.width) > CAMERA.cx
    whose: dict[tuple[int, int], NDArray[np.int64]] = {}
    for number, thing in enumerate(things):
        for side in (0, 1):
            pixels = np.flatnonzero((seen.colour == thing.colour).all(-1) & (right == side))
            if len(pixels):
                whose[number, side] = pixels
    joined = join_occluded(list(whose.values()), points, surface_normals(seen.depth, CAMERA), UP)
    assert np.array_equal(np.sort(np.concatenate(joined)), np.sort(np.concatenate(list(whose.values()))))
    return sorted(sorted(key for key, pixels in whose.items() if np.isin(pixels, group).all()) for group in joined)


@pytest.mark.parametrize("noise", [False, True])
def test_the_parts_beside_what_stands_in_front_are_joined(noise: bool) -> None:
    assert [(0, 0), (0, 1)] in parts_of(CARTON, POST, noise=noise)


@pytest.mark.parametrize(
    ("name", "left", "right"),
    [
        ("of another height", (0.1, 0.16), (0.1, 0.11)),
        ("one behind the other", (0.1, 0.16), (0.2, 0.16)),
    ],
)
def test_two_things_behind_another_are_two(name: str, left: tuple[float, float], right: tuple[float, float]) -> None:
    a, b = (
        standing(x, y, (0.14, 0.08, tall), colour=colour)
        for x, (y, tall), colour in ((-0.08, left, RED), (0.08, right, BLUE))
    )
    found = parts_of(a, b, POST)
    assert not any({(0, 0), (1, 1)} <= set(group) for group in found), name


def test_with_nothing_in_front_nothing_is_joined() -> None:
    """Two cartons in a row, with a gap between them through which the wall is seen."""
    a, b = (standing(x, 0.1, (0.14, 0.08, 0.16), colour=colour) for x, colour in ((-0.1, RED), (0.1, BLUE)))
    assert parts_of(a, b) == [[(0, 0)], [(1, 1)]]


def test_of_nothing_nothing_is_joined() -> None:
    points = np.zeros((12, 16, 3), np.float32)
    assert join_occluded([], points, points, UP) == []


def test_a_part_by_itself_stays() -> None:
    points = np.ones((12, 16, 3), np.float32)
    (only,) = join_occluded([np.arange(10)], points, points, UP)
    assert only.tolist() == list(range(10))
