"""Surface points, the plane map and the small algebra beneath the pose providers."""

import numpy as np
import pytest
from numpy.typing import NDArray

from made_frame import frame_of
from spot3d.camera import Intrinsics, invert
from spot3d.depth_noise import KINECT_V1
from spot3d.pose.given import GivenPoses
from spot3d.pose.motion import (
    checked_pose,
    extrapolated,
    moved,
    vector_from_rotation,
)
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import _SUMS, GRAZING_COS, _sum_cells, information, sample_surface
from spot3d.pose.surfel_map import SurfelMap
from spot3d.trajectory import rotation_from_vector

CAMERA = Intrinsics(300.0, 300.0, 160.0, 120.0, 320, 240)
SETTINGS = PoseSettings(lattice_width=80)


def plane_depth(normal: NDArray[np.float64], offset: float) -> NDArray[np.float32]:
    """Depth of the plane normal . p = offset."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack(((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)), axis=-1)
    return (offset / (rays @ normal)).astype(np.float32)


@pytest.mark.parametrize("depth_m", [0.0, 1e-40, 1e30, np.nan, np.inf])
def test_no_depth_that_a_camera_measures_gives_no_points(depth_m: float) -> None:
    assert len(sample_surface(np.full(CAMERA.shape, depth_m, np.float32), CAMERA, SETTINGS).points) == 0


def test_cell_sums_equal_the_plain_sums() -> None:
    cell, range_max = 5, 4.0
    rng = np.random.default_rng(2)
    depth = rng.uniform(0.5, 5.0, (23, 34)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.3] = 0
    sums = np.empty((4, 6, _SUMS), np.float32)
    _sum_cells(depth, cell, np.float32(range_max), sums)
    v, u = np.mgrid[:cell, :cell] - 0.5 * (cell - 1)
    for row, column in np.ndindex(4, 6):
        z = depth[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell].astype(np.float64)
        valid = (z > 0) & (z < range_max)
        q = 1 / np.where(valid, z, np.inf)
        one = valid.astype(np.float64)
        terms = (one, u * one, v * one, u * u * one, u * v * one, v * v * one, q, u * q, v * q, q * q)
        np.testing.assert_allclose(sums[row, column], [term.sum() for term in terms], rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 1.0), (0.4, 0.0, 1.0), (-0.2, 0.5, 1.0)])
def test_a_plane_is_met_exactly(tilt: tuple[float, float, float]) -> None:
    normal = np.array(tilt) / np.linalg.norm(tilt)
    surface = sample_surface(plane_depth(normal, 1.5), CAMERA, SETTINGS)
    assert len(surface.points) > 4000
    np.testing.assert_allclose(surface.points @ normal, 1.5, atol=1e-4)
    np.testing.assert_allclose(surface.normals, np.tile(-normal, (len(surface.points), 1)), atol=1e-3)


def test_the_fit_averages_noise_away() -> None:
    flat = plane_depth(np.array([0.0, 0.0, 1.0]), 2.0)
    sigma = float(KINECT_V1.sigma(2.0))
    noisy = flat + np.random.default_rng(0).normal(0, sigma, flat.shape).astype(np.float32)
    surface = sample_surface(noisy, CAMERA, SETTINGS)
    assert len(surface.points) > 4000
    # 144 pixels a fit: a twelfth of one pixel's noise.
    assert float(np.std(surface.points[:, 2])) < sigma / 9
    assert float(np.median(surface.sigma)) == pytest.approx(sigma, rel=0.05)


def test_jumps_holes_range_and_grazing_views_give_no_points() -> None:
    step = plane_depth(np.array([0.0, 0.0, 1.0]), 1.0)
    step[:, 160:] = 1.2
    points = sample_surface(step, CAMERA, SETTINGS).points
    assert ((points[:, 2] < 1.001) | (points[:, 2] > 1.199)).all()
    holes = np.where(np.arange(320) % 2 == 0, step, 0).astype(np.float32)
    assert len(sample_surface(holes, CAMERA, SETTINGS).points) == 0
    assert len(sample_surface(step + np.float32(4), CAMERA, SETTINGS).points) == 0
    floor = np.clip(plane_depth(np.array([0.0, 1.0, 0.0801]), 0.4), 0, 3).astype(np.float32)
    surface = sample_surface(floor, CAMERA, SETTINGS)
    cosines = -np.sum(surface.points * surface.normals, axis=1) / np.linalg.norm(surface.points, axis=1)
    assert len(surface.points) > 100
    assert cosines.min() >= GRAZING_COS - 1e-3


def test_size_mismatch_is_refused() -> None:
    with pytest.raises(ValueError, match="the intrinsics are for"):
        sample_surface(np.ones((10, 10), np.float32), CAMERA, SETTINGS)


def weakness(depth: NDArray[np.float32]) -> float:
    surface = sample_surface(depth, CAMERA, SETTINGS)
    least = float(np.linalg.eigvalsh(information(surface))[0])
    return (least**-0.5 if least > 0 else np.inf) / float(np.median(surface.sigma))


def test_a_plane_leaves_directions_free_and_a_corner_does_not() -> None:
    """However far away the corner is, and depth noisy: the pose is better known than each point."""
    wall = plane_depth(np.array([0.0, 0.0, 1.0]), 1.5)
    corner = np.minimum(wall, plane_depth(np.array([0.8, 0.0, 0.6]), 0.9))
    positive = plane_depth(np.array([0.0, 0.8, 0.6]), 1.0)
    corner = np.minimum(corner, np.where(positive > 0, positive, np.inf)).astype(np.float32)
    for farther in (1, 2.5):
        assert weakness((farther * wall).astype(np.float32)) > SETTINGS.weakness_max
        assert weakness((farther * corner).astype(np.float32)) < SETTINGS.weakness_max / 2


def test_normal_equations_point_to_the_plane() -> None:
    surface = sample_surface(plane_depth(np.array([0.0, 0.0, 1.0]), 1.5), CAMERA, SETTINGS)
    planes = SurfelMap(0.05, 20_000)
    planes.insert(surface, np.eye(4))
    off = np.eye(4)
    off[2, 3] = 0.004
    H, g, (tried, matched, squares) = planes.normal_equations(surface, off, 0.05, 3.0)
    assert tried == matched == len(surface.points)
    assert (squares / matched) ** 0.5 == pytest.approx(0.004, abs=1e-4)
    assert g[2] / H[2, 2] == pytest.approx(-0.004, abs=1e-4)
    _, _, (tried, matched, _) = planes.normal_equations(surface, off, 0.002, 3.0)
    assert (tried, matched) == (len(surface.points), 0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_surface_finds_its_plane_from_the_voxel_beside(side: float) -> None:
    """A wall a millimetre from the border between two voxels is met from either side of it, from half a voxel away."""
    voxel = 0.05
    wall = plane_depth(np.array([0.0, 0.0, 1.0]), 1.5 + 0.001 * side)
    surface = sample_surface(wall, CAMERA, SETTINGS)
    planes = SurfelMap(voxel, 20_000)
    planes.insert(surface, np.eye(4))
    for away, meets in ((-0.4, True), (0.4, True), (-0.6 * side, False)):
        pose = np.eye(4)
        pose[2, 3] = away * voxel
        H, g, (tried, matched, _) = planes.normal_equations(surface, pose, 0.05, 100.0)
        assert matched == (tried if meets else 0)
        if meets:
            assert g[2] / H[2, 2] == pytest.approx(-away * voxel, rel=0.01)


def test_a_map_may_do_without_the_voxel_beside() -> None:
    surface = sample_surface(plane_depth(np.array([0.0, 0.0, 1.0]), 1.501), CAMERA, SETTINGS)
    planes, pose = SurfelMap(0.05, 20_000, beside=False), np.eye(4)
    planes.insert(surface, pose)
    for away, share in ((0.02, 1.0), (-0.02, 0.0)):
        pose[2, 3] = away
        _, _, (tried, matched, _) = planes.normal_equations(surface, pose, 0.05, 100.0)
        assert matched == share * tried


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.1, -0.2, 0.3), (0.0, 0.0, 3.0)])
def test_rotation_vectors_round_trip(vector: tuple[float, float, float]) -> None:
    rotation = rotation_from_vector(np.array(vector))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(vector_from_rotation(rotation), vector, atol=1e-12)


def test_constant_velocity() -> None:
    step = moved(np.eye(4), np.array([0.1, 0.0, -0.2, 0.0, 0.05, 0.02]))
    np.testing.assert_allclose(extrapolated(np.eye(4), step, 1.0), step @ step, atol=1e-12)
    np.testing.assert_allclose(extrapolated(np.eye(4), step, 0.0), step, atol=1e-12)
    np.testing.assert_allclose(step @ invert(step), np.eye(4), atol=1e-12)


@pytest.mark.parametrize(
    "bad",
    [
        None,
        np.eye(3),
        np.full((4, 4), np.nan),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([2.0, 2.0, 2.0, 1.0]),
        np.ones((4, 4)),
    ],
)
def test_given_poses(bad: NDArray[np.float64] | None) -> None:
    tracker, depth = GivenPoses(), np.zeros(CAMERA.shape, np.float32)
    good = moved(np.eye(4), np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    estimate = tracker.track(frame_of(1, depth, CAMERA, good))
    assert (estimate.status, estimate.reason) == ("ok", "")
    np.testing.assert_allclose(estimate.T_world_camera, good, atol=1e-12)
    lost = tracker.track(frame_of(2, depth, CAMERA, bad))
    assert lost.status == "lost"
    assert lost.reason
    np.testing.assert_allclose(lost.T_world_camera, good, atol=1e-12)


def test_rounded_rotations_are_made_exact() -> None:
    good = moved(np.eye(4), np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    mended = checked_pose(np.round(good, 3))
    assert mended is not None
    np.testing.assert_allclose(mended[:3, :3] @ mended[:3, :3].T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("metres", "valid"), [(1e7, True), (1.1e7, False), (1e155, False), (np.inf, False)])
def test_a_pose_off_earth_is_none(metres: float, valid: bool) -> None:
    T = np.eye(4)
    T[1, 3] = -metres
    assert (checked_pose(T) is not None) == valid


def test_a_map_that_is_too_large_to_be_restored_keeps_what_was_seen_last() -> None:
    planes = SurfelMap(0.05, 20_000)
    for number in range(4):
        T = np.eye(4)
        T[0, 3] = 2.0 * number
        planes.insert(sample_surface(np.ones(CAMERA.shape, np.float32), CAMERA, PoseSettings()), T)
    keys, surfels = planes.held()
    smaller = SurfelMap(0.05, len(keys) // 4)
    smaller.restore(keys, surfels)
    assert smaller.count == len(keys) // 4
    assert smaller.held()[1][:, 7].min() > 3
