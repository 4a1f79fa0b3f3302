"""The dashboard's copy of a map, and how the world is turned and drawn."""

import numpy as np
import pytest

from spot3d.dashboard.points import CHUNK, MapCopy, heat_colours
from spot3d.dashboard.world import Trail, plane_patches, quaternion
from spot3d.trajectory import rotation_to_z
from spot3d_schemas import Header, MapChanges

HEADER = Header(robot="robot", seq=0, stamp_ns=1, frame_id="camera")


def changes(numbers: list[int], frequency: int = 5, generation: int = 1, cursor: int = 9) -> MapChanges:
    count = len(numbers)
    number = np.array(numbers, np.uint32)
    return MapChanges(
        header=HEADER,
        generation=generation,
        cursor=cursor,
        behind=0,
        number=number,
        xyz=np.repeat(number[:, None], 3, axis=1).astype(np.float32),
        rgb=np.full((count, 3), 7, np.uint8),
        heat=np.full(count, 100, np.uint8),
        frequency=np.full(count, frequency, np.uint32),
        planes=np.zeros((0, 4)),
        total=count,
    )


def test_points_come_change_and_go() -> None:
    copy = MapCopy(100_000)
    assert copy.apply(changes([0, 3, CHUNK + 1]))
    assert (len(copy.points()[0]), copy.chunks, copy.dirty) == (3, 2, {0, 1})
    copy.dirty.clear()
    assert not copy.apply(changes([3], frequency=0))
    assert copy.dirty == {0}
    xyz, rgb, heat, _ = copy.chunk(0)
    assert (xyz.tolist(), rgb.tolist(), heat.tolist()) == ([[0, 0, 0]], [[7, 7, 7]], [100])
    assert copy.points()[0][:, 0].tolist() == [0, CHUNK + 1]


def test_another_map_begins_with_nothing() -> None:
    copy = MapCopy(100_000)
    copy.apply(changes([0, CHUNK]))
    copy.dirty.clear()
    assert copy.apply(changes([1], generation=2))
    assert copy.points()[0][:, 0].tolist() == [1]
    assert copy.dirty == {0, 1}, "what was shown of the old map is taken away"


def test_points_beyond_the_limit_are_counted_and_left_out() -> None:
    copy = MapCopy(1000)
    copy.apply(changes([999, 1000, 2**32 - 1]))
    assert (len(copy.points()[0]), copy.left_out) == (1, 2)


def test_heat_has_a_colour() -> None:
    colours = heat_colours(np.array([0, 128, 255], np.uint8))
    assert colours.sum(axis=1).tolist() == sorted(colours.sum(axis=1).tolist()), "hotter is brighter"
    assert heat_colours(np.zeros(0, np.uint8)).shape == (0, 3)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (0, 0, -1), (0.6, 0, 0.8), (-0.48, -0.6, -0.64)])
def test_the_world_is_turned_so_that_z_is_up(up: tuple[float, float, float]) -> None:
    R = rotation_to_z(np.array(up))
    np.testing.assert_allclose(R @ np.array(up), [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1)
    w, *axis = quaternion(R)
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    np.testing.assert_allclose(np.eye(3) + 2 * w * K + 2 * K @ K, R, atol=1e-9)


def test_a_path_stays_bounded_and_keeps_its_ends() -> None:
    trail = Trail()
    assert trail.segments().shape == (0, 2, 3)
    for x in (0, 0.01):
        trail.add(np.array([x, 0, 0]))
    assert len(trail.segments()) == 0, "nearer than 2 cm"
    for step in range(1, 5000):
        trail.add(np.array([0.05 * step, 0, 0]))
    segments = trail.segments()
    assert 500 < len(segments) <= 2000
    assert segments[0, 0].tolist() == [0, 0, 0]
    assert segments[-1, 1, 0] == pytest.approx(0.05 * 4999, abs=0.5)
    np.testing.assert_array_equal(segments[:-1, 1], segments[1:, 0])


def test_a_plane_is_shown_where_points_lie_on_it() -> None:
    rng = np.random.default_rng(0)
    table = np.column_stack((rng.uniform(0, 1.2, 4000), rng.uniform(0, 0.6, 4000), np.full(4000, 0.7)))
    wall = np.column_stack((rng.uniform(0, 3, 500), np.full(500, 4.0), rng.uniform(0, 2, 500)))
    planes = np.array([[0, 0, 1, -0.7], [0, 0, 1, 5.0]])
    (patch,) = plane_patches(planes, np.vstack((table, wall)).astype(np.float32))
    np.testing.assert_allclose(patch[:, 2], 0.705, atol=1e-5)
    edges = np.linalg.norm(np.roll(patch, 1, axis=0) - patch, axis=1)
    np.testing.assert_allclose(sorted(edges), [0.55, 0.55, 1.1, 1.1], atol=0.06)
    assert plane_patches(planes, np.zeros((0, 3), np.float32)) == []
