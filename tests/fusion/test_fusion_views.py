"""What could be seen from where, and which objects that bears out."""

import numpy as np
import pytest
from fusion_room import CAMERA, look_at

from spot3d.boxes import Box3D
from spot3d.fusion.identity import FoundObject
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.views import Views, borne_out

SETTINGS = FusionSettings(range_max=2.5)
ORIGIN = np.zeros(3)


def views(*eyes: tuple[float, float, float]) -> Views:
    """Views from these points towards the world's origin."""
    kept = Views()
    for eye in eyes:
        kept.add(look_at(eye, (0, 0, 0)), CAMERA)
    return kept


def found(width: float, count: int) -> FoundObject:
    box = Box3D(ORIGIN, np.array([width, width, 0.2]), np.eye(3))
    return FoundObject(0, box, 0.5, count, 500, np.zeros(3))


def test_a_point_is_seen_from_where_it_is_in_the_picture_and_in_range() -> None:
    kept = views((0, -1, 0.5), (0, -2, 1.0), (0, -3, 1.0), (5, 5, 1.0))
    above, behind = (0, -1.0, 5.0), (0, -4.0, 2.0)  # behind all that look from near by
    share, depth = kept.looking_at(np.array([ORIGIN, above, behind, (0, -0.2, 0.1)]), 2.5)
    np.testing.assert_array_equal(share, [0.5, 0, 0, 0.5])
    np.testing.assert_allclose(depth[:3], [np.mean([np.hypot(1, 0.5), np.hypot(2, 1)]), 2.5, 2.5])
    np.testing.assert_array_equal(Views().looking_at(ORIGIN[None], 2.5), [[0.0], [2.5]])
    np.testing.assert_allclose(views((0, -1, 0.5)).looking_at(ORIGIN[None], 2.5), [[1.0], [np.hypot(1, 0.5)]])


@pytest.mark.parametrize(
    ("name", "eye", "width", "count", "kept"),
    [
        ("seen all the time", (0, -1, 0.5), 0.05, 100, True),
        ("seen now and then", (0, -1, 0.5), 0.05, 11, True),
        ("a transient", (0, -1, 0.5), 0.05, 9, False),
        ("seldom looked at", (4, 0, 0.5), 0.06, 9, True),
        ("small but near", (0, -1, 0.5), 0.02, 100, True),
        ("lost in the noise", (0, -2.2, 0.5), 0.04, 100, False),
        ("large enough", (0, -2.2, 0.5), 0.06, 100, True),
    ],
)
def test_evidence_is_judged_by_views_and_noise(
    name: str, eye: tuple[float, float, float], width: float, count: int, kept: bool
) -> None:
    item = found(width, count)
    assert borne_out([item], views(eye), 100, SETTINGS) == [item] * kept, name


def test_views_are_bounded_and_stay_evenly_spread() -> None:
    kept = Views()
    for k in range(5000):
        kept.add(look_at((0, -1 if k < 2500 else -9, 0.5), (0, 0, 0)), CAMERA)
    assert kept.looking_at(ORIGIN[None], 2.5)[0] == pytest.approx(0.5, abs=0.01)
    assert len(kept._pinhole) <= 1000
