"""What lies in another's box is a part of it, unless it is a thing in the room that this has."""

import dataclasses

import numpy as np
import pytest
from fusion_room import TABLE, Cuboid, look_at, rotation_z, standing, view

from spot3d.camera import Intrinsics, back_project
from spot3d.geometry.normals import surface_normals
from spot3d.segments.contained import join_contained

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)


def open_box(x: float, yaw: float, size: tuple[float, float, float], height: float = 0.0) -> tuple[Cuboid, ...]:
    """A bottom and four walls, 1 cm thick, of one colour."""
    length, width, tall = size
    R, middle = rotation_z(yaw), (x, 0.0)

    def plank(at: tuple[float, float, float], dimensions: tuple[float, float, float]) -> Cuboid:
        moved = R @ at + (*middle, height)
        return Cuboid((float(moved[0]), float(moved[1]), float(moved[2])), dimensions, yaw, (60, 90, 200), heat=1.0)

    return (
        plank((0, 0, 0.005), (length, width, 0.01)),
        *(plank((0, side * width / 2, tall / 2), (length, 0.01, tall)) for side in (-1, 1)),
        *(plank((side * length / 2, 0, tall / 2), (0.01, width, tall)) for side in (-1, 1)),
    )


def joined(
    parts: list[tuple[Cuboid, ...]], eye: tuple[float, float, float] = (0.1, -0.8, 0.7), shadow: int = 0
) -> list[list[int]]:
    """Which parts are joined, by number, seen by a camera with noise that looks at them from `eye`. shadow: so many
    pixels to the right of the last one and below it have no depth."""
    painted = [dataclasses.replace(one, colour=(number + 1, 0, 0)) for number, part in enumerate(parts) for one in part]
    T = look_at(eye)
    frame = view(T, (TABLE, *painted), np.random.default_rng(0), CAMERA)
    masks = [(frame.colour == (number + 1, 0, 0)).all(-1) for number in range(len(parts))]
    depth, (h, w) = frame.depth.copy(), frame.depth.shape
    v, u = np.nonzero(masks[-1])
    for k in range(1, shadow + 1):
        for right, below in ((k, 0), (0, k), (k, k)):
            depth[np.minimum(v + below, h - 1), np.minimum(u + right, w - 1)] = 0
    depth[masks[-1]] = frame.depth[masks[-1]]
    pixels = [np.flatnonzero(mask & (depth > 0)) for mask in masks]
    points, normals = back_project(depth, CAMERA), surface_normals(depth, CAMERA)
    rows = join_contained(pixels, points, normals, T[:3, :3].T @ (0, 0, 1.0))
    assert np.array_equal(np.sort(np.concatenate(rows)), np.sort(np.concatenate(pixels)))
    return sorted(sorted({int(frame.colour.reshape(-1, 3)[row, 0]) - 1 for row in one}) for one in rows)


CRATE = open_box(0.0, 0.3, (0.4, 0.3, 0.14))
CARTON = (standing(-0.05, 0.02, (0.1, 0.08, 0.09)),)


@pytest.mark.parametrize("eye", [(0.1, -0.8, 0.7), (0.0, -0.6, 1.0), (0.7, 0.7, 0.6), (0.0, -0.4, 1.0)])
@pytest.mark.parametrize("content", [CARTON, (standing(0.05, 0.03, (0.09, 0.12, 0.2)),)])
def test_what_is_in_an_open_box_is_no_part_of_it(content: tuple[Cuboid, ...], eye: tuple[float, float, float]) -> None:
    assert joined([CRATE, content], eye) == [[0], [1]]


@pytest.mark.parametrize("eye", [(0.1, -0.5, 0.8), (0.0, -0.3, 1.0), (0.02, -0.01, 1.1)])
@pytest.mark.parametrize("tall", [0.09, 0.13])
def test_what_stands_on_the_floor_of_an_open_box_is_no_part_of_it(tall: float, eye: tuple[float, float, float]) -> None:
    """However little room is left above it, and though a camera above it sees nothing of it but its top."""
    assert joined([CRATE, (standing(-0.05, 0.02, (0.1, 0.08, tall)),)], eye) == [[0], [1]]


@pytest.mark.parametrize(("eye", "shadow"), [((0.0, -0.3, 1.0), 3), ((0.02, -0.01, 1.1), 6)])
def test_a_shadow_without_depth_beside_a_thing_is_no_sign_against_a_floor(
    eye: tuple[float, float, float], shadow: int
) -> None:
    """A projector's, which things cast to one side: so many pixels wide."""
    assert joined([CRATE, (standing(-0.05, 0.02, (0.1, 0.08, 0.13)),)], eye, shadow) == [[0], [1]]


def test_a_neck_above_a_foot_is_a_part_of_the_screen() -> None:
    """Most of what is seen beside it is the foot and the table, but not all: it reaches up to the screen."""
    screen = Cuboid((0, 0.0, 0.27), (0.4, 0.03, 0.3)), Cuboid((0, -0.02, 0.01), (0.25, 0.2, 0.02))
    assert joined([screen, (Cuboid((0, -0.03, 0.07), (0.06, 0.03, 0.1)),)]) == [[0, 1]]


def test_the_walls_and_the_bottom_of_an_open_box_are_one() -> None:
    bottom, *walls = CRATE
    assert joined([tuple(walls), (bottom,)]) == [[0, 1]]
    assert joined([(bottom, *walls[::2]), tuple(walls[1::2])]) == [[0, 1]]


@pytest.mark.parametrize(
    ("name", "part", "whole"),
    [
        ("a carton's top", Cuboid((0, 0, 0.1), (0.1, 0.1, 0.004)), standing(0, 0, (0.2, 0.16, 0.1))),
        ("a knob on its front", Cuboid((0, -0.08, 0.06), (0.03, 0.012, 0.03)), standing(0, 0, (0.2, 0.16, 0.12))),
    ],
)
def test_what_is_on_a_thing_is_a_part_of_it(name: str, part: Cuboid, whole: Cuboid) -> None:
    assert joined([(whole,), (part,)]) == [[0, 1]], name


def test_what_is_flat_is_a_part_of_it_whatever_room_there_is() -> None:
    """As a foot's plate is of a screen."""
    screen = Cuboid((0, 0.1, 0.2), (0.4, 0.02, 0.4)), Cuboid((0, 0.0, 0.01), (0.25, 0.2, 0.02))
    assert joined([screen, (Cuboid((0, 0.0, 0.022), (0.15, 0.1, 0.004)),)]) == [[0, 1]]


def test_what_stands_on_a_shelf_is_no_part_of_it() -> None:
    """A board, a back and a side, seen from the front."""
    shelf = Cuboid((0, 0, 0.3), (0.6, 0.3, 0.02)), Cuboid((0, 0.15, 0.45), (0.6, 0.02, 0.3))
    side, thing = Cuboid((-0.3, 0, 0.45), (0.02, 0.3, 0.3)), Cuboid((0.05, 0.03, 0.37), (0.1, 0.1, 0.12), 0.8)
    assert joined([(*shelf, side), (thing,)], eye=(0.2, -0.8, 0.7)) == [[0], [1]]


def test_what_touches_stays_apart() -> None:
    assert joined([(standing(0, 0, (0.2, 0.16, 0.1)),), (standing(0.17, 0, (0.13, 0.16, 0.1)),)]) == [[0], [1]]


def test_nothing_is_joined_to_nothing() -> None:
    nothing = np.zeros((4, 4, 3), np.float32)
    assert join_contained([], nothing, nothing, np.array((0, -1.0, 0))) == []
