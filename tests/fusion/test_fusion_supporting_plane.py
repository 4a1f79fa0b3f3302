"""Which plane supports objects, by heat."""

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, look_at, view

from spot3d.camera import back_project, invert
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supporting_plane import supporting_plane
from spot3d.geometry.planes import on_plane, transform_plane

SETTINGS = FusionSettings()
POSE = look_at((0.9, -1.3, 0.8), (0.3, 0.5, -0.15))  # sees table, floor and wall
PLANES = transform_plane(np.array([[0, 0, 1.0, 0], [0, 0, 1.0, 0.75], [0, -1.0, 0, 1.5]]), invert(POSE))
POINTS = back_project(view(POSE, ROOM, np.random.default_rng(0)).depth, CAMERA)


@pytest.mark.parametrize("expected", [0, 1, 2])
def test_heat_decides_which_plane_supports(expected: int) -> None:
    heat = np.where(on_plane(PLANES[expected], POINTS, SETTINGS), 100, 10).astype(np.uint8)
    np.testing.assert_array_equal(supporting_plane(PLANES, POINTS, heat, SETTINGS), PLANES[expected])


def test_without_planes_none_supports() -> None:
    heat = np.zeros(CAMERA.shape, np.uint8)
    assert supporting_plane(np.zeros((0, 4)), POINTS, heat, SETTINGS) is None


@pytest.mark.parametrize(("name", "value"), [("no heat at all", 0), ("an object's own face, hot all over", 200)])
def test_a_plane_without_bare_and_warm_parts_supports_nothing(name: str, value: int) -> None:
    heat = np.where(on_plane(PLANES[0], POINTS, SETTINGS), value, 0).astype(np.uint8)
    assert supporting_plane(PLANES[:1], POINTS, heat, SETTINGS) is None, name
