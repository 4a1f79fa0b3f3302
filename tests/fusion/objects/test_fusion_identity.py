"""Objects keep their numbers from update to update."""

import numpy as np
import pytest
from fusion_room import rotation_z

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.fusion.objects import identity
from spot3d.fusion.objects.identity import Identities


def found(x: float, size: float = 0.1, yaw: float = 0.0) -> FoundObject:
    box = Box3D(np.array([x, 0, 0.05]), np.full(3, size), rotation_z(yaw))
    return FoundObject(0, box, 0.5, 10, 100, np.zeros(3))


def at(objects: list[FoundObject]) -> dict[int, float]:
    return {item.id: round(float(item.box.centre[0]), 2) for item in objects}


def test_nothing_found_is_nothing_numbered() -> None:
    assert Identities().assign([]) == []


def test_numbers_start_at_one_in_the_given_order() -> None:
    assert at(Identities().assign([found(3), found(1), found(2)])) == {1: 3.0, 2: 1.0, 3: 2.0}


def test_numbers_are_stable_under_jitter() -> None:
    identities, rng = Identities(), np.random.default_rng(0)
    first = at(identities.assign([found(x) for x in (0.0, 0.2, 0.4, 0.6)]))
    for _ in range(50):
        places = np.array([0.0, 0.2, 0.4, 0.6])[rng.permutation(4)]
        jitter = rng.normal(0, (0.01, 0.005, 0.1), (4, 3))
        seen = [found(x + dx, 0.1 + ds, yaw) for x, (dx, ds, yaw) in zip(places, jitter, strict=True)]
        again = identities.assign(seen)
        assert {item.id: round(float(item.box.centre[0]) / 0.2) * 0.2 for item in again} == pytest.approx(first)
        assert [item.id for item in again] == sorted(item.id for item in again)


def test_the_better_overlap_keeps_the_number() -> None:
    identities = Identities()
    identities.assign([found(0.0)])
    assert at(identities.assign([found(0.05), found(0.01)])) == {1: 0.01, 2: 0.05}


def test_an_object_that_returns_has_its_number_again() -> None:
    identities = Identities()
    identities.assign([found(0.0), found(1.0)])
    identities.assign([found(1.0)])
    assert at(identities.assign([found(1.0), found(0.01), found(2.0)])) == {1: 0.01, 2: 1.0, 3: 2.0}


def test_memory_is_bounded_and_forgets_the_longest_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identity, "_REMEMBERED", 3)
    identities = Identities()
    for x in (0.0, 1.0, 2.0, 0.0, 3.0):
        identities.assign([found(x)])
    assert at(identities.assign([found(0.0)])) == {1: 0.0}
    assert at(identities.assign([found(1.0)])) == {5: 1.0}
