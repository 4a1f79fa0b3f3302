"""The built-in scene that changes: one thing is taken, one moved, one put down, and all else stays as it is."""

from itertools import combinations

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.source.scene.changing import CHANGE_FRAME, things_on_changing_table
from spot3d.source.scene.placement import TABLE_HEIGHT, footprint, separation
from spot3d.source.scene.scene import Scene
from spot3d.source.scene.table import things_on_table

SMALL = Intrinsics(585 / 4, 585 / 4, 80.0, 60.0, 160, 120)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 44])
def test_one_is_taken_one_moved_and_one_put_down(seed: int) -> None:
    before, after = things_on_table(seed, cluttered=False), things_on_changing_table(seed, changed=True)
    assert things_on_changing_table(seed, changed=False) == before
    assert len(after) == len(before) + 1
    (taken,) = (number for number, item in enumerate(after) if item is None)
    (moved,) = (n for n, (old, new) in enumerate(zip(before, after, strict=False)) if n != taken and old != new)
    new, added = after[moved], after[-1]
    assert new is not None
    assert added is not None
    assert new.thing == before[moved].thing
    assert np.hypot(new.x - before[moved].x, new.y - before[moved].y) >= 0.15
    for item in (new, added):
        assert item.z == TABLE_HEIGHT
        assert min(separation(footprint(item), footprint(p)) for p in before if p.z == TABLE_HEIGHT) > 0.0299
    assert separation(footprint(new), footprint(added)) > 0.0299
    for a, b in combinations(before, 2):
        low, high = (a, b) if a.z < b.z else (b, a)
        if low.z < high.z and separation(footprint(low), footprint(high)) < 0:
            assert before.index(low) not in (taken, moved), "carries something"
    assert before[taken].z == before[moved].z == TABLE_HEIGHT


def test_until_the_change_it_is_the_table() -> None:
    changing, table = Scene(1, "changing", intrinsics=SMALL), Scene(1, intrinsics=SMALL)
    for index in (0, CHANGE_FRAME - 1):
        np.testing.assert_array_equal(changing[index].depth, table[index].depth)
        np.testing.assert_array_equal(changing.truth(index).instance, table.truth(index).instance)


@pytest.mark.parametrize("index", [CHANGE_FRAME, 299])
def test_what_has_not_changed_has_its_number_and_its_place(index: int) -> None:
    changing, table = Scene(1, "changing", intrinsics=SMALL), Scene(1, intrinsics=SMALL)
    now, then = changing.truth(index), table.truth(index)
    old, new = ({box.id: box.centre.tolist() for box in scene.boxes} for scene in (table, changing))
    changed = [number for number in old | new if old.get(number) != new.get(number)]
    assert len(changed) == 3
    as_it_was = ~np.isin(now.instance, changed) & ~np.isin(then.instance, changed)
    np.testing.assert_array_equal(now.instance[as_it_was], then.instance[as_it_was])
    np.testing.assert_array_equal(now.depth[as_it_was], then.depth[as_it_was])
    assert set(np.unique(now.instance).tolist()) <= {0, *new}
    assert 0.5 < as_it_was.mean() < 0.99
    assert changing[index].T_world_camera is not None
    np.testing.assert_array_equal(changing.true_pose(index), table.true_pose(index))


@pytest.mark.parametrize(("frames", "settled_from"), [(CHANGE_FRAME, 0), (CHANGE_FRAME + 1, CHANGE_FRAME)])
def test_boxes_are_those_of_the_last_frame(frames: int, settled_from: int) -> None:
    scene, table = Scene(1, "changing", frames, SMALL), Scene(1, intrinsics=SMALL)
    assert scene.settled_from == settled_from
    names, before = ([box.name for box in one.boxes] for one in (scene, table))
    assert (names == before) == (settled_from == 0)
