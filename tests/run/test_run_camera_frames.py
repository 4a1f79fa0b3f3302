import numpy as np

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.run.camera_frames import FRAMES_MOST, CameraFrames

CAMERA = Intrinsics(10.0, 10.0, 3.5, 2.5, 8, 6)


def test_frames_are_kept_from_all_along_the_way() -> None:
    frames = CameraFrames()
    assert frames.image == (0, 0)
    stamps = [round(number * 1e9 / 30) for number in range(30 * 60)]
    for stamp in stamps:
        frames.add(RgbdFrame(stamp, np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16), 0.001, CAMERA))
        assert len(frames) <= FRAMES_MOST
    assert frames.image == (8, 6)
    gaps = np.diff([*frames.stamps_ns, stamps[-1]])
    assert len(frames) > FRAMES_MOST // 2 - 1
    assert frames.stamps_ns[0] == 0
    assert gaps.max() < 2 * gaps[:-1].min()
