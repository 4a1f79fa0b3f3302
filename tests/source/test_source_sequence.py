"""What every sequence of frames tells about itself."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source.sequence import FrameList

CAMERA = Intrinsics(4.0, 4.0, 1.5, 1.5, 4, 4)
S = 10**9


@pytest.mark.parametrize(
    ("stamps_ns", "rate_hz"),
    [
        ([], 30.0),
        ([5], 30.0),
        ([5, 5, 5], 30.0),
        ([0, S // 10, S // 5, 9 * S], 10.0),
        ([0, 0, 0, S, S, S, 2 * S, 2 * S], 1.0),  # whole seconds
    ],
)
def test_the_rate_is_that_of_different_stamps(stamps_ns: list[int], rate_hz: float) -> None:
    colour, depth = np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint16)
    frames = FrameList(RgbdFrame(stamp_ns, colour, depth, 0.001, CAMERA) for stamp_ns in stamps_ns)
    assert frames.rate_hz == rate_hz
