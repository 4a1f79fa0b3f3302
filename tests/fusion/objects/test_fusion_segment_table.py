"""What is entered of a keyframe's segments: how noise scatters them, and what they stand on."""

from dataclasses import replace

import numpy as np
import pytest
from voting_room import POSES, keyframe

from spot3d.depth_noise import DepthNoise
from spot3d.fusion.objects.segment_table import SegmentTable, _blur


def test_noise_scatters_along_the_ray_by_more_than_from_near() -> None:
    middles = np.array([[0, 0, 0.5], [0, 0, 2.5], [1.5, 0, 2.0]], np.float32)
    blur = _blur(middles, DepthNoise(floor=0.001, growth=0.002, at=0.5))
    np.testing.assert_allclose(blur, [[0, 0, 0], [0, 0, 0.008], [0.0045 * 0.6, 0, 0.0045 * 0.8]], atol=1e-7)


@pytest.mark.parametrize("off", [-0.012, 0.0, 0.012])
def test_a_support_lies_where_it_is_seen_around_a_segment(off: float) -> None:
    """Depth bends planes: the one of the whole view is a centimetre off there."""
    frame, segments = keyframe(POSES[3]), SegmentTable()
    segments.extend(replace(frame, planes=frame.planes + np.array([[0, 0, 0, off]])), 0)
    assert len(segments) == 3
    np.testing.assert_allclose(segments.support.rows, [[0, 0, 1, 0]] * 3, atol=0.002)
