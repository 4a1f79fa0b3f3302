"""What leans stands on its lower edge, and all else on all of itself."""

import dataclasses

import numpy as np
import pytest
from fusion_room import rotation_z
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.fusion.objects.balance import TILT
from spot3d.fusion.objects.footing import lower_edge
from spot3d.fusion.objects.found import ObjectViews, box_of
from spot3d.fusion.objects.outline import OUTERMOST
from spot3d.fusion.objects.views import SAMPLE

UP = np.array([0.0, 0.0, 1.0])
VIEWS = 24


def seen(points: list[NDArray[np.float64]]) -> tuple[ObjectViews, Box3D]:
    """What was seen of a thing on a table, (SAMPLE, 3) points for each view, and its box."""
    count = len(points)
    eyes = np.tile((1.0, 0.0, 0.5), (count, 1))
    places = np.array(points, np.float32)
    outline, blur = np.full((count, OUTERMOST, 3), np.nan, np.float32), np.zeros((count, 3), np.float32)
    table = np.broadcast_to(np.array([0.0, 0.0, 1.0, 0.0]), (count, 4))
    views = ObjectViews(places, outline, blur, table, np.arange(count), eyes)
    return views, box_of(views, UP, 0.005)


def edge_of(points: list[NDArray[np.float64]]) -> tuple[Box3D | None, Box3D]:
    """The lower edge, and the box, of what was seen."""
    views, box = seen(points)
    return lower_edge(views, box, TILT), box


def sheet(tilt: float, yaw: float = 0.0, noise: float = 0.002, seed: int = 0) -> list[NDArray[np.float64]]:
    """Views of 30 by 22 cm that lean back by some degrees from a line through the origin."""
    rng, angle, views = np.random.default_rng(seed), np.radians(tilt), []
    for _ in range(VIEWS):
        along, width = rng.uniform(0, 0.22, SAMPLE), rng.uniform(-0.15, 0.15, SAMPLE)
        x, z = -along * np.sin(angle), along * np.cos(angle)
        off = rng.normal(0, noise, SAMPLE)
        points = np.column_stack((x + off * np.cos(angle), width, z + off * np.sin(angle)))
        views.append(points @ rotation_z(yaw).T)
    return views


@pytest.mark.parametrize("yaw", [0.0, 0.8, 2.5])
@pytest.mark.parametrize("tilt", [12.0, 20.0, 40.0])
def test_the_lower_edge_of_a_lid_is_where_it_is_fixed(tilt: float, yaw: float) -> None:
    edge, box = edge_of(sheet(tilt, yaw))
    assert edge is not None
    assert np.linalg.norm(edge.centre) < 0.012
    assert edge.size[:2].min() < 0.025
    assert edge.size[:2].max() == pytest.approx(0.3, abs=0.03)
    assert float(edge.centre @ UP) == pytest.approx(float(box.centre @ UP - box.size[2] / 2))


def test_a_lid_thinner_than_its_noise_has_a_lower_edge() -> None:
    """As one far away has: its faces are where noise scatters them to, less that noise, and so may cross."""
    views, box = seen(sheet(20.0))
    noisy = dataclasses.replace(views, blur=np.full_like(views.blur, 0.02))
    edge = lower_edge(noisy, box, TILT)
    assert edge is not None
    assert 0 < edge.size[:2].min() < 0.025


def test_a_view_that_takes_in_what_is_before_a_lid_does_not_hide_how_thin_it_is() -> None:
    views = sheet(20.0)
    views[3][::3] = np.column_stack((np.linspace(0, 0.2, SAMPLE), np.zeros(SAMPLE), np.zeros(SAMPLE)))[::3]
    edge, _ = edge_of(views)
    assert edge is not None
    assert np.linalg.norm(edge.centre) < 0.012


@pytest.mark.parametrize("tilt", [0.0, 6.0, 60.0, 88.0])
def test_what_stands_upright_or_lies_on_its_back_does_not_lean(tilt: float) -> None:
    assert edge_of(sheet(tilt))[0] is None


@pytest.mark.parametrize("size", [(0.12, 0.12, 0.12), (0.06, 0.06, 0.2), (0.1, 0.2, 0.3)])
def test_of_a_box_the_front_and_the_top_do_not_lean(size: tuple[float, float, float]) -> None:
    rng, views = np.random.default_rng(1), []
    for _ in range(VIEWS):
        points = rng.uniform(-0.5, 0.5, (SAMPLE, 3)) * size
        front = rng.uniform(size=SAMPLE) < 0.6
        points[front, 0], points[~front, 2] = size[0] / 2, size[2] / 2
        views.append(points + np.array((0, 0, size[2] / 2)))
    assert edge_of(views)[0] is None


def test_a_ball_does_not_lean() -> None:
    rng, views = np.random.default_rng(2), []
    for _ in range(VIEWS):
        normals = rng.normal(size=(SAMPLE, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        # As seen from before and above.
        normals *= np.sign(normals @ (0.8, 0.0, 0.6))[:, None]
        views.append(0.06 * normals + np.array((0, 0, 0.06)))
    assert edge_of(views)[0] is None
