"""The bounded map of planes: what it averages, meets and forgets, and how it follows the scale of depth."""

import numpy as np
import pytest

from spot3d.pose.landmark_map import LANDMARK, LandmarkMap
from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import SurfelMap

VOXEL = 0.05
Vector = tuple[float, float, float]


def surface(*places: Vector, normal: Vector = (0, 0, -1), sigma: float = 0.001) -> Surface:
    points = np.array(places, np.float32)
    normals = np.tile(np.float32(normal) / np.linalg.norm(normal).astype(np.float32), (len(points), 1))
    return Surface(points, normals, np.full(len(points), sigma, np.float32))


def seen_from(*place: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = place
    return T


def matched(planes: SurfelMap, seen: Surface) -> int:
    return int(planes.normal_equations(seen, np.eye(4), VOXEL, 4.5)[2][1])


def test_a_full_map_drops_the_half_unseen_for_longest_and_takes_no_more_than_there_is_room_for() -> None:
    planes = SurfelMap(VOXEL, 4)
    planes.insert(surface((0.01, 0, 1), (0.11, 0, 1), (0.21, 0, 1)), np.eye(4))
    planes.insert(surface((0.31, 0, 1), (0.41, 0, 1), (0.51, 0, 1)), np.eye(4))
    assert (planes.count, planes.forgotten) == (len(planes.held()[0]), 1) == (4, 1)


def test_nothing_is_left_of_a_surfel_that_was_forgotten() -> None:
    planes = SurfelMap(VOXEL, 2)
    for x in (0.01, 0.11, 0.21, 0.03):
        planes.insert(surface((x, 0.0, 1.01)), np.eye(4))
    np.testing.assert_allclose(np.sort(planes.held()[1][:, 0]), [0.03, 0.21], atol=1e-6)


def test_a_surfel_stays_open_to_change() -> None:
    planes = SurfelMap(VOXEL, 10)
    for _ in range(3):
        planes.insert(surface((0.01, 0.01, 1.01), sigma=1e-4), np.eye(4))
    assert planes.held()[1][0, 6] == 1000


def test_depth_grows_from_where_the_cameras_were() -> None:
    planes = SurfelMap(VOXEL, 10)
    planes.insert(surface((0.5, 0.2, 1.0)), seen_from(3.0, 0.0, 0.0))
    planes.rescale(1.1)
    np.testing.assert_allclose(planes.held()[1][0, :3], (3.55, 0.22, 1.1), atol=1e-6)
    assert matched(planes, surface((3.55, 0.22, 1.1))) == 1, "it is found in the voxel where it lies now"


@pytest.mark.parametrize(("sigmas", "stays"), [((0.001, 0.004), 0.032), ((0.004, 0.001), 0.048)])
def test_of_two_surfels_that_come_into_one_voxel_the_better_known_stays(
    sigmas: tuple[float, float], stays: float
) -> None:
    planes = SurfelMap(VOXEL, 10)
    for x, sigma in zip((0.04, 0.06), sigmas, strict=True):
        planes.insert(surface((x, 0.01, 1.27), sigma=sigma), np.eye(4))
    planes.rescale(0.8)
    np.testing.assert_allclose(planes.held()[1][:, 0], [stays], atol=1e-6)


def test_a_restored_map_goes_on_counting_frames() -> None:
    planes, again = SurfelMap(VOXEL, 10), SurfelMap(VOXEL, 10)
    for x in (0.01, 0.11, 0.21):
        planes.insert(surface((x, 0, 1)), np.eye(4))
    again.restore(*planes.held())
    again.insert(surface((0.31, 0, 1)), np.eye(4))
    assert sorted(again.held()[1][:, 7]) == [1, 2, 3, 4]


@pytest.mark.parametrize(("z", "expected"), [(0.0501, 1), (0.06, 0)])
def test_a_plane_is_met_from_half_a_voxel_beside_its_own_at_most(z: float, expected: int) -> None:
    planes = SurfelMap(VOXEL, 10)
    planes.insert(surface((0.01, 0.01, 0.03)), np.eye(4))
    assert matched(planes, surface((0.01, 0.01, z))) == expected


def test_a_crease_is_no_plane() -> None:
    planes = SurfelMap(VOXEL, 10)
    for x in (0.6, -0.6):
        planes.insert(surface((0.01, 0.01, 1.01), normal=(x, 0, -0.8)), np.eye(4))
    assert len(planes.held()[0]) == 1
    assert matched(planes, surface((0.01, 0.01, 1.01))) == 0


def test_a_surface_that_faces_elsewhere_does_not_meet_a_plane() -> None:
    planes = SurfelMap(VOXEL, 10)
    planes.insert(surface((0.01, 0.01, 1.01), normal=(0.69, 0, -0.72)), np.eye(4))
    assert matched(planes, surface((0.01, 0.01, 1.01), normal=(0.5, 0, -0.8))) == 1
    assert matched(planes, surface((0.01, 0.01, 1.01), normal=(-0.69, 0, -0.72))) == 0


def test_of_too_many_landmarks_those_known_last_are_restored() -> None:
    rows, landmarks = np.zeros(3, LANDMARK), LandmarkMap(2)
    rows["last"] = (7, 30, 12)
    landmarks.restore(rows)
    assert landmarks.rows["last"].tolist() == [30, 12]
    assert landmarks._frames == 30


def noisy(normals: np.ndarray, seed: int) -> Surface:
    """Points 5 mm apart on a plane a metre away for each normal, (n, 3), which noise turns by about 5 degrees."""
    x, y = np.meshgrid(np.arange(-0.3, 0.3, 0.005), np.arange(-0.3, 0.3, 0.005))
    points = np.stack((x, y, np.ones_like(x)), axis=-1).reshape(-1, 3)
    turned = np.repeat(normals, len(points), axis=0)
    turned = turned + np.random.default_rng(seed).normal(0, 0.09, turned.shape)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    places = np.tile(points, (len(normals), 1)).astype(np.float32)
    return Surface(places, turned.astype(np.float32), np.full(len(turned), 0.001, np.float32))


@pytest.mark.parametrize(
    ("normals", "least", "most"),
    [(np.array([[0, 0, -1.0]]), 0.0, 0.15), (np.array([[0, 0, -1.0], [-1.0, 0, 0], [0, -1.0, 0]]), 0.9, 1.1)],
)
def test_what_two_views_have_in_common_is_structure_and_no_noise(
    normals: np.ndarray, least: float, most: float
) -> None:
    """Of a shift that a plane leaves free the map's normals alone, squared, know something; both views' do not."""
    planes = SurfelMap(VOXEL, 10_000)
    planes.insert(noisy(normals, 0), np.eye(4))
    seen, shared = noisy(normals, 1), np.zeros((6, 6))
    squared, _, _ = planes.normal_equations(seen, np.eye(4), VOXEL, 4.5, shared=shared)
    assert least * squared[0, 0] <= abs(shared[0, 0]) <= most * squared[0, 0]
