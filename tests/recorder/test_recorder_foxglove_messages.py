"""Points along the edges of boxes."""

import numpy as np
import pytest

from spot3d.boxes import Box3D
from spot3d.drawing.picture import object_colour
from spot3d.found_object import FoundObject
from spot3d.recorder.foxglove_messages import edge_points
from spot3d.trajectory import rotation_from_quaternion

CENTRE, SIZE = np.array((0.1, -0.2, 1.5)), np.array((0.3, 0.2, 0.1))


def test_of_nothing_there_are_none() -> None:
    xyz, rgb = edge_points(())
    assert xyz.shape == rgb.shape == (0, 3)


def test_they_lie_on_the_twelve_edges_without_a_gap() -> None:
    rotation = rotation_from_quaternion(np.array((0.1, 0.2, 0.3, 0.9)) / np.linalg.norm((0.1, 0.2, 0.3, 0.9)))
    item = FoundObject(7, Box3D(CENTRE, SIZE, rotation), 0.5, 3, 100, np.zeros(3))
    xyz, rgb = edge_points((item,))
    inside = np.abs((xyz - CENTRE) @ rotation) / (SIZE / 2)
    on_faces = np.isclose(inside, 1, atol=1e-4).sum(axis=1)
    assert inside.max() < 1 + 1e-4
    assert set(on_faces) == {2, 3}
    assert (on_faces == 3).sum() == 24, "each corner ends three edges"
    steps = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
    assert sorted(steps)[-12] == pytest.approx(0.005, abs=1e-5), "eleven steps lead to the next edge"
    assert (rgb == object_colour(7)).all()
