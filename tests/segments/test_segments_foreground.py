"""What stands out: above the support, on no wall, and wider than a pixel."""

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, THREE, Cuboid, look_at, view
from numpy.typing import NDArray

from spot3d.camera import back_project, invert
from spot3d.geometry.normals import surface_normals
from spot3d.geometry.planes import transform_plane
from spot3d.segments.foreground import long_pieces, standing_out
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import noise_height

SETTINGS = SegmentsSettings()
POSE = look_at((0, -0.95, 0.7))
TABLE = transform_plane(np.array([0, 0, 1.0, 0]), invert(POSE))
WALL = transform_plane(np.array([0, -1.0, 0, 1.5]), invert(POSE))
BOXES = np.array([cuboid.colour for cuboid in THREE])


def out_of(
    depth: NDArray[np.float32], others: list[NDArray[np.float64]], settings: SegmentsSettings = SETTINGS
) -> NDArray[np.bool_]:
    points = back_project(depth, CAMERA)
    height = (points @ TABLE[:3] + TABLE[3]).astype(np.float32)
    long, normals = np.zeros(depth.shape, np.bool_), surface_normals(depth, CAMERA)
    for plane in others:
        long |= long_pieces(points, normals, np.ones(depth.shape, np.bool_), plane, settings)
    return standing_out(
        points, height, noise_height(depth, TABLE, settings), np.zeros(depth.shape, np.bool_), long, settings
    )


def test_the_objects_stand_out_and_the_table_does_not() -> None:
    seen = view(POSE, ROOM + THREE)
    objects = (seen.colour[..., None, :] == BOXES).all(-1).any(-1)
    out = out_of(seen.depth, [WALL])
    assert not out[~objects].any()
    assert out[objects].mean() > 0.85, "all but their lowest centimetre"


def test_a_wall_is_longer_than_an_object_and_a_small_board_is_not() -> None:
    for width, expected in ((2.0, False), (0.5, True)):
        board = Cuboid((0, 0.4, 0.3), (width, 0.02, 0.6), colour=(1, 2, 3))
        plane = transform_plane(np.array([0, -1.0, 0, 0.39]), invert(POSE))
        seen = view(POSE, (*ROOM, board))
        on_board = (seen.colour == board.colour).all(-1)
        assert (out_of(seen.depth, [plane])[on_board].mean() > 0.5) == expected
        assert out_of(seen.depth, [])[on_board].mean() > 0.9, "nobody says that it lies on a plane"


def test_what_touches_a_walls_plane_but_faces_elsewhere_stays() -> None:
    """A box against the wall: its sides cross the wall's plane."""
    shelf = Cuboid((0, 0.45, 0.1), (0.3, 0.3, 0.2), colour=(9, 9, 9))
    seen = view(POSE, (*ROOM, shelf))
    plane = transform_plane(np.array([0, 0, 1.0, -0.2]), invert(POSE))  # that of its top
    assert out_of(seen.depth, [plane])[(seen.colour == 9).all(-1)].mean() > 0.9


def test_specks_do_not_stand_out() -> None:
    seen = view(POSE, ROOM)
    clean = out_of(seen.depth, [WALL])
    specks = np.random.default_rng(0).choice(30 * 40, 200, replace=False)  # one in a block of 4 x 4
    v, u = np.divmod(specks, 40)
    depth = seen.depth.copy()
    depth[4 * v, 4 * u] -= 0.1
    assert not clean.any()
    assert not out_of(depth, [WALL]).any()


@pytest.mark.parametrize(("range_max", "expected"), [(2.5, True), (0.6, False)])
def test_what_is_too_far_is_not_looked_at(range_max: float, expected: bool) -> None:
    settings = SETTINGS.model_copy(update={"range_max": range_max})
    assert out_of(view(POSE, ROOM + THREE).depth, [WALL], settings).any() == expected


def test_without_depth_nothing_stands_out() -> None:
    assert not out_of(np.zeros(CAMERA.shape, np.float32), [WALL]).any()


def test_a_view_that_is_all_wall_is_a_wall() -> None:
    """There is nothing beside its only piece."""
    depth = np.full(CAMERA.shape, 2.0, np.float32)
    points, normals = back_project(depth, CAMERA), surface_normals(depth, CAMERA)
    height = np.full(CAMERA.shape, 0.5, np.float32)
    facing = np.array([0, 0, -1.0, 2.0])
    nothing = np.zeros(CAMERA.shape, np.bool_)
    for size_max, is_long in ((SETTINGS.size_max, True), (3.0, False)):
        settings = SETTINGS.model_copy(update={"size_max": size_max})
        long = long_pieces(points, normals, ~nothing, facing, settings)
        assert long.all() if is_long else not long.any()
        out = standing_out(points, height, noise_height(depth, TABLE, settings), nothing, long, settings)
        assert not out.any() if is_long else out.all()


def test_what_is_beside_the_support_stands_out_though_it_is_lower() -> None:
    seen = view(POSE, ROOM + THREE)
    points = back_project(seen.depth, CAMERA)
    height = np.full(CAMERA.shape, -0.2, np.float32)
    beside = (seen.colour[..., None, :] == BOXES).all(-1).any(-1)
    tolerance = noise_height(seen.depth, TABLE, SETTINGS)
    out = standing_out(points, height, tolerance, beside, np.zeros(CAMERA.shape, np.bool_), SETTINGS)
    assert not out[~beside].any()
    assert out[beside].mean() > 0.9


def test_a_plane_through_a_bent_table_and_a_laptop_on_it_is_no_long_piece() -> None:
    """The table goes on where the laptop's top ends, as far as this plane tells."""
    laptop = Cuboid((0, 0, 0.01), (0.4, 0.3, 0.02), colour=(9, 9, 9))
    seen = view(POSE, (*ROOM, laptop))
    points, normals = back_project(seen.depth, CAMERA), surface_normals(seen.depth, CAMERA)
    on_laptop = (seen.colour == 9).all(-1)
    settings = SETTINGS.model_copy(update={"plane_distance": 0.015})
    between = transform_plane(np.array([0, 0, 1.0, -0.01]), invert(POSE))
    off = np.abs(points @ TABLE[:3] + TABLE[3]) > 0.015
    assert long_pieces(points, normals, off | True, between, settings)[on_laptop].mean() > 0.5
    assert not long_pieces(points, normals, off, between, settings).any()
