"""The keyframes' planes, grouped by K-means."""

import numpy as np
import pytest
from sklearn.cluster import KMeans

from spot3d.fusion import structure
from spot3d.fusion.structure import KeyframePlane, PlaneMemory

TABLE, WALL, SHELF = np.array([0, 0, 1.0, 0]), np.array([0, -1.0, 0, 1.5]), np.array([0, 0, 1.0, -0.4])


def jittered(plane: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    normal = plane[:3] + rng.normal(0, 0.01, 3)
    return np.append(normal / np.linalg.norm(normal), plane[3] + rng.normal(0, 0.004))


def room_memory(keyframes: int = 20) -> PlaneMemory:
    memory, rng = PlaneMemory(), np.random.default_rng(0)
    for number in range(keyframes):
        memory.add(KeyframePlane(jittered(TABLE, rng), 50.0, number % 4 != 0))
        memory.add(KeyframePlane(jittered(SHELF, rng), 10.0, number % 4 == 0))
        memory.add(KeyframePlane(jittered(WALL, rng), 0.0, False))
    return memory


def test_no_keyframe_no_plane() -> None:
    assert PlaneMemory().distinct(np.zeros(3)) == []


@pytest.mark.parametrize("around", [np.zeros(3), np.array([0.3, 0.2, 0.1])])
def test_planes_are_grouped_hottest_first(around: np.ndarray) -> None:
    groups = room_memory().distinct(around)
    assert [group.removed_share for group in groups] == [0.75, 0.25, 0.0]
    assert [group.heat for group in groups] == [750.0, 50.0, 0.0]
    for group, truth in zip(groups, (TABLE, SHELF, WALL), strict=True):
        np.testing.assert_allclose(group.plane, truth, atol=0.01)
        assert np.linalg.norm(group.plane[:3]) == pytest.approx(1)


def test_k_means_are_those_of_scikit_learn() -> None:
    features = np.random.default_rng(1).normal(0, 1, (300, 4))
    labels = KMeans(7, init=features[:7], n_init=1, tol=0).fit_predict(features)
    np.testing.assert_array_equal(structure._k_means(features, features[:7]), labels)


def test_opposite_sides_are_two_planes() -> None:
    memory = PlaneMemory()
    for plane in (TABLE, -TABLE):
        memory.add(KeyframePlane(plane, 1.0, True))
    assert len(memory.distinct(np.zeros(3))) == 2


def test_a_copy_is_not_changed_by_what_follows() -> None:
    memory = room_memory()
    copy = memory.copy()
    memory.clear()
    assert memory.distinct(np.zeros(3)) == []
    assert len(copy.distinct(np.zeros(3))) == 3


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structure, "_REMEMBERED", 30)
    memory = room_memory(500)
    assert len(memory._planes) <= 30
    groups = memory.distinct(np.zeros(3))
    np.testing.assert_allclose(groups[0].plane, TABLE, atol=0.02)


def test_groups_are_the_plain_means_and_medians() -> None:
    memory = room_memory(7)
    stack = np.array([item.plane for item in memory._planes])
    for group, of in zip(memory.distinct(np.zeros(3)), (0, 1, 2), strict=True):
        normal = stack[of::3, :3].mean(axis=0)
        np.testing.assert_allclose(group.plane[:3], normal / np.linalg.norm(normal), atol=1e-12)
        assert group.plane[3] == pytest.approx(np.median(stack[of::3, 3]), abs=1e-12)
