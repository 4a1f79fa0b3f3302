"""Built-in scenes as data sets: what is true of one that changes is what its last frames show."""

import numpy as np
import pytest

from spot3d.boxes import Box3D
from spot3d.evaluate.datasets import open_dataset
from spot3d.evaluate.points import points_in_boxes
from spot3d.evaluate.truth import LabelledScene
from spot3d.settings import Settings
from spot3d.source.scene.model import TrueBox, build_scene
from spot3d.source.scene.scene import Scene

BEFORE, AFTER = ({box.id: box for box in build_scene(1, "changing", frame).boxes} for frame in (0, 150))
(TAKEN,) = BEFORE.keys() - AFTER.keys()
(ADDED,) = AFTER.keys() - BEFORE.keys()
(MOVED,) = (n for n in BEFORE.keys() & AFTER.keys() if not np.array_equal(BEFORE[n].centre, AFTER[n].centre))


def truth_of(every: int, frames: int) -> LabelledScene:
    truth = open_dataset("scene:1:changing", Settings(), every, frames).sequences[0].truth
    assert truth is not None
    return truth


def share_inside(truth: LabelledScene, label: int, box: TrueBox) -> float:
    grown = Box3D(box.centre, box.size + 0.002, box.rotation)
    return float(points_in_boxes(truth.xyz[truth.label == label], [grown]).mean())


def test_the_truth_of_a_scene_that_changes_is_the_ends() -> None:
    truth = truth_of(every=20, frames=15)
    assert TAKEN not in truth.label
    assert {MOVED, ADDED} <= set(truth.labels)
    for label, box in zip(truth.labels, truth.boxes, strict=True):
        np.testing.assert_array_equal(box.centre, AFTER[label].centre)
        assert share_inside(truth, label, AFTER[label]) == 1
    for number in (TAKEN, MOVED):
        old = BEFORE[number]
        above_table = Box3D(old.centre + np.array((0, 0, 0.005)), old.size - np.array((0, 0, 0.01)), old.rotation)
        assert not points_in_boxes(truth.xyz, [above_table]).any(), "nothing is left of it"


@pytest.mark.parametrize(("every", "frames"), [(1, 30), (50, 3), (49, 4)])
def test_the_truth_of_a_stretch_before_the_change_is_what_it_shows(every: int, frames: int) -> None:
    truth = truth_of(every, frames)
    assert ADDED not in truth.label
    assert {TAKEN, MOVED} <= set(truth.label.tolist())
    assert share_inside(truth, MOVED, BEFORE[MOVED]) == 1


def test_single_frames_are_true_of_their_own_moment() -> None:
    frames, scene = open_dataset("scene:1:changing", Settings(), 150, 2).readers, Scene(1, "changing", 151)
    for number, index in enumerate((0, 150)):
        ids, pixels = np.unique(scene.truth(index).instance, return_counts=True)
        assert len(frames[number]().boxes) == np.count_nonzero(pixels[ids > 0] >= 200)
        assert (TAKEN in ids, ADDED in ids) == (index == 0, index == 150)
