"""The paper's clustering: K-means over removed planes, DBSCAN, upright boxes, merging, volume, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import COARSE_PAPER, STAGE, THREE, Cuboid, sampled, standing

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.found_object import FoundObject
from spot3d.fusion.map.selection import FrequentPoints
from spot3d.fusion.objects.reasons import TOO_SMALL
from spot3d.fusion.paper.density import (
    cluster_by_density,
    density_labels,
    find_by_density,
    intersecting,
    unique_planes,
    up_direction,
)
from spot3d.fusion.settings import PAPER, FusionSettings

UP = np.array([0.0, 0.0, 1.0])
TABLE, FLOOR, WALL = np.array([[0, 0, 1.0, 0], [0, 0, 1.0, 0.75], [0, -1.0, 0, 1.5]])


def keyframes(*counts: tuple[np.ndarray, int]) -> np.ndarray:
    """So many estimates of each plane, a degree and 2 mm off."""
    rng, planes = np.random.default_rng(0), []
    for plane, count in counts:
        normal = plane[:3] + rng.normal(0, 0.01, (count, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        planes.append(np.column_stack((normal, plane[3] + rng.normal(0, 0.002, count))))
    return np.concatenate(planes)


def found_in(points: FrequentPoints, settings: FusionSettings = COARSE_PAPER) -> list[FoundObject]:
    return find_by_density(points, TABLE[None], settings)[0]


def objects_only(*things: Cuboid) -> FrequentPoints:
    return sampled((STAGE[0], *things))


def test_k_means_finds_the_different_planes_among_the_keyframes() -> None:
    removed = unique_planes(keyframes((FLOOR, 3), (TABLE, 12), (WALL, 5)))
    np.testing.assert_allclose(removed, [TABLE, WALL, FLOOR], atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(removed[:, :3], axis=1), 1)


@pytest.mark.parametrize("count", [1, 2, 30])
def test_one_plane_is_one_however_often_it_was_removed(count: int) -> None:
    assert len(unique_planes(keyframes((TABLE, count)))) == 1
    assert len(unique_planes(np.tile(TABLE, (count, 1)))) == 1


def test_planes_that_only_few_keyframes_removed_are_removed_at_the_end() -> None:
    """The table was seen late and kept its heat: the few keyframes that removed it show it."""
    points = sampled((STAGE[0], *THREE), cold=0.4)
    points = points.take(points.xyz[:, 2] > -0.001)
    few, *_ = find_by_density(points, np.stack((FLOOR, FLOOR, FLOOR, TABLE)), COARSE_PAPER)
    none, *_ = find_by_density(points, np.stack((FLOOR, FLOOR, FLOOR)), COARSE_PAPER)
    assert (iou_matrix_3d([thing.box() for thing in THREE], [item.box for item in few]).max(axis=1) > 0.4).all()
    assert len(few) == 3
    assert max(item.box.size.max() for item in none) > 1.39
    kept, *_ = find_by_density(points, TABLE[None], COARSE_PAPER.model_copy(update={"plane_removal": False}))
    assert max(item.box.size.max() for item in kept) > 1.39, "noPlRem"


def test_up_is_the_normal_of_the_maps_points_on_the_plane_removed_most() -> None:
    rng = np.random.default_rng(1)
    xyz = np.column_stack((rng.uniform(-1, 1, (3000, 2)), rng.normal(0, 0.001, 3000))).astype(np.float32)
    tilted = np.array([0.002, 0.0, 1.0, 0.0])
    np.testing.assert_allclose(up_direction(tilted, xyz, PAPER), UP, atol=1e-3)
    np.testing.assert_allclose(up_direction(tilted, xyz[:2], PAPER), tilted[:3], atol=1e-4)


def test_without_planes_or_points_there_are_no_objects() -> None:
    points = sampled(STAGE + THREE)
    assert find_by_density(points, np.zeros((0, 4)), COARSE_PAPER)[0] == []
    assert found_in(points.take(np.zeros(len(points), bool))) == []


def test_boxes_below_the_least_volume_are_counted() -> None:
    for least, count in ((1e-6, 0), (1.0, 3)):
        settings = COARSE_PAPER.model_copy(update={"volume_min": least})
        found, _, left_out = find_by_density(objects_only(*THREE), TABLE[None], settings)
        assert (len(found), left_out) == (3 - count, {TOO_SMALL: count} if count else {})


def test_separated_objects_are_found_most_confident_first() -> None:
    things = (THREE[0], replace(THREE[1], heat=0.8), replace(THREE[2], heat=0.9))
    found = found_in(objects_only(*things))
    assert [item.confidence for item in found] == pytest.approx([0.5, 0.45, 0.4], abs=0.01)
    truth = [things[k].box() for k in (0, 2, 1)]
    overlap = np.diag(iou_matrix_3d(truth, [item.box for item in found]))
    assert (overlap > 0.4).all()  # boxes along fixed axes are larger than turned ones
    for item, k in zip(found, (0, 2, 1), strict=True):
        assert item.views == 20
        np.testing.assert_allclose(item.colour, things[k].colour)


def test_points_are_ranked_one_by_one() -> None:
    """Half of an object is cold: the other half is the object, whatever their mean."""
    points = objects_only(standing(0, 0, (0.2, 0.1, 0.1)))
    cold = points.xyz[:, 0] > 0
    points = replace(points, heat=np.where(cold, np.float32(0.24), points.heat))
    (half,) = found_in(points)
    assert half.box.size[0] == pytest.approx(0.1, abs=0.01)


def test_boxes_are_upright_along_common_axes_and_not_turned() -> None:
    (found,) = found_in(objects_only(standing(0, 0, (0.2, 0.1, 0.1), yaw=0.6)))
    c, s = np.cos(0.6), np.sin(0.6)
    np.testing.assert_allclose(found.box.rotation, np.eye(3), atol=1e-3)
    np.testing.assert_allclose(found.box.size[:2], [0.2 * c + 0.1 * s, 0.2 * s + 0.1 * c], atol=0.01)


@pytest.mark.parametrize(
    ("name", "size", "count"),
    [
        ("longer than eps_max", (1.3, 0.3, 0.2), 1),
        ("smaller than eps_min", (0.014, 0.014, 0.014), 1),
        ("as thin as a plane", (0.2, 0.2, 0.008), 1),
        ("of less than 1 cm3", (0.009, 0.009, 0.014), 0),
    ],
)
def test_volume_alone_decides(name: str, size: tuple[float, float, float], count: int) -> None:
    points = sampled((STAGE[0], standing(0.0, 0.0, size)), step=0.002)
    assert len(found_in(points, PAPER)) == count, name


@pytest.mark.parametrize(
    ("name", "x", "groups"),
    [
        ("nothing", [], []),
        ("apart", [0.0, 1.0], [[0], [1]]),
        ("touching is not intersecting", [0.0, 0.2], [[0], [1]]),
        ("a chain", [0.0, 1.0, 0.3, 0.15], [[0, 2, 3], [1]]),
    ],
)
def test_boxes_that_intersect_become_one(name: str, x: list[float], groups: list[list[int]]) -> None:
    low, size = np.column_stack((x, np.zeros((len(x), 2)))).reshape(-1, 3), np.array([0.2, 0.1, 0.1])
    assert [sorted(group) for group in intersecting(low, low + size)] == groups, name


def test_a_common_box_takes_in_what_neither_part_met() -> None:
    low = np.array([[2.7, 0.6, 0], [2, 2, 0], [0, 0, 0], [1, 0, 0]])
    high = np.array([[2.9, 1.5, 1], [3, 3, 1], [1.5, 2.5, 1], [2.5, 0.5, 1]])
    assert [sorted(group) for group in intersecting(low[1:], high[1:])] == [[0, 1, 2]]
    assert [sorted(group) for group in intersecting(low, high)] == [[0, 1, 2, 3]], "the first meets all others' alone"


def test_clusters_of_one_object_are_merged_by_their_boxes() -> None:
    """A slanting stick above a block: no point near another, and the boxes intersect."""
    stick = np.linspace((-0.1, 0, 0.05), (0.1, 0, 0.35), 400)
    block = sampled((standing(-0.05, 0.0, (0.08, 0.02, 0.04)),)).xyz + np.array([0.12, 0, 0.1])
    xyz = np.concatenate((stick, block)).astype(np.float32)
    labels = density_labels(xyz, COARSE_PAPER)
    ((rows, box),), _ = cluster_by_density(xyz, UP, COARSE_PAPER)
    assert set(labels.tolist()) == {0, 1}
    assert len(rows) == len(xyz)
    assert isinstance(box, Box3D)


@pytest.mark.parametrize("density_points", [8, 20])
def test_thinned_points_cluster_as_all_points_do(density_points: int) -> None:
    points = sampled((*THREE, standing(0.3, 0.4, (0.1, 0.1, 0.1))), step=0.003).xyz
    labels = [
        density_labels(points, PAPER.model_copy(update={"density_points": density_points, "density_cell": cell}))
        for cell in (0.0, 0.005)
    ]
    same = [labels[k][:, None] == np.arange(4) for k in (0, 1)]
    assert set(labels[0].tolist()) == set(labels[1].tolist()) == {0, 1, 2, 3}
    overlap = same[0].T.astype(int) @ same[1].astype(int)
    assert (np.count_nonzero(overlap, axis=0) == 1).all()


def test_lone_points_are_noise() -> None:
    lone = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0]], np.float32)
    assert density_labels(lone, PAPER).tolist() == [-1, -1, -1]
    assert density_labels(lone[:0], PAPER).shape == (0,)
