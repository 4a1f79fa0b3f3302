"""Lower supports: what is beside the main one stands on the highest that reaches there; walls and tops of things carry
nothing."""

import dataclasses

import numpy as np
from fusion_room import CAMERA, FLOOR, WALL, Cuboid, View, look_at, view
from numpy.typing import NDArray

from spot3d.camera import back_project, invert
from spot3d.geometry.normals import surface_normals
from spot3d.geometry.planes import transform_plane
from spot3d.segments.foreground import long_pieces
from spot3d.segments.levels import Levels, LongPieces, with_lower
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import beside_support, noise_height

SETTINGS = SegmentsSettings()
POSE = look_at((0.1, -1.3, 0.9), (0, 0, -0.25))
SMALL_TABLE = Cuboid((0, 0, -0.02), (0.7, 0.6, 0.04), colour=(180, 150, 110))
BAG = Cuboid((0.62, -0.1, -0.60), (0.25, 0.3, 0.30), colour=(1, 2, 3))
STEP = Cuboid((0, 0.75, -0.65), (2.4, 0.6, 0.20), colour=(4, 5, 6))


def seen_plane(x: float, y: float, z: float, b: float) -> NDArray[np.float64]:
    """A plane of the world, (4,), in the camera frame."""
    return transform_plane(np.array([x, y, z, b]), invert(POSE))


GROUND, BACK, TOP_OF_BAG = seen_plane(0, 0, 1, 0.75), seen_plane(0, -1, 0, 1.5), seen_plane(0, 0, 1, 0.45)
STEPS_TOP = seen_plane(0, 0, 1, 0.55)


def levels_of(seen: View, *others: NDArray[np.float64], settings: SegmentsSettings = SETTINGS) -> Levels:
    points = back_project(seen.depth, CAMERA)
    normals, table = surface_normals(seen.depth, CAMERA), seen_plane(0, 0, 1, 0)
    height = (points @ table[:3] + table[3]).astype(np.float32)
    tolerance = noise_height(seen.depth, table, settings)
    main = Levels(table[None], np.zeros(height.shape, np.int8), height, tolerance)
    beside = beside_support(points, normals, height, tolerance, table[:3], settings)
    off = np.abs(height) > tolerance
    pieces: list[LongPieces] = [(plane, long_pieces(points, normals, off, plane, settings)) for plane in others]
    return with_lower(main, beside, pieces, points, settings, CAMERA.noise)


def own(seen: View, thing: Cuboid) -> NDArray[np.bool_]:
    return np.asarray((seen.colour == thing.colour).all(-1))


def test_what_is_beside_a_table_is_above_the_floor_and_what_is_on_it_is_not() -> None:
    cup = Cuboid((0.1, 0, 0.05), (0.1, 0.1, 0.1), colour=(7, 8, 9))
    seen = view(POSE, (SMALL_TABLE, FLOOR, WALL, BAG, cup))
    levels = levels_of(seen, BACK, GROUND, TOP_OF_BAG)
    np.testing.assert_array_equal(levels.planes, [seen_plane(0, 0, 1, 0), GROUND])
    bag = own(seen, BAG)
    assert (levels.number[bag] == 1).all()
    assert 0.29 < levels.height[bag].max() < 0.31
    assert levels.height[bag].min() > -0.01
    assert (levels.number[own(seen, cup)] == 0).all()
    assert (levels.number[own(seen, SMALL_TABLE)] == 0).all(), "its front is the table's"
    floor = own(seen, FLOOR) & (levels.number == 1)
    assert floor.any()
    assert (np.abs(levels.height[floor]) < levels.tolerance[floor]).all()


def test_a_thing_is_above_the_highest_that_reaches_there() -> None:
    on_step = dataclasses.replace(BAG, centre=(0.62, 0.75, -0.40))
    seen = view(POSE, (SMALL_TABLE, FLOOR, WALL, BAG, STEP, on_step))
    levels = levels_of(seen, GROUND, STEPS_TOP, settings=SETTINGS.model_copy(update={"size_max": 0.5}))
    np.testing.assert_array_equal(levels.planes[1:], [STEPS_TOP, GROUND])
    v, u = np.nonzero(own(seen, BAG))
    xyz = back_project(seen.depth, CAMERA)[v, u] @ POSE[:3, :3].T + POSE[:3, 3]
    near = xyz[:, 1] < 0.2
    assert near.any()
    assert (levels.number[v, u] == 2)[near].all()
    assert (levels.number[v, u] == 1)[~near].mean() > 0.98, "but for pixels beyond what is seen of the step"
    assert levels.of(np.flatnonzero(own(seen, BAG)), 0.005) == 2, "the lowest of them"


def test_without_a_lower_support_all_stays_as_it_was() -> None:
    seen = view(POSE, (SMALL_TABLE, FLOOR, WALL, BAG))
    levels = levels_of(seen, BACK)
    assert len(levels.planes) == 1
    assert not levels.number.any()
    assert levels.height[own(seen, BAG)].max() < 0
