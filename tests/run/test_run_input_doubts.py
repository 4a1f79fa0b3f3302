"""What a run says of a recording before it is played."""

from pathlib import Path

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.run.input_doubts import input_doubts
from spot3d.source.calibration import SEVEN_SCENES_COLOUR, SEVEN_SCENES_DEPTH, ColourCamera, load_calibration
from spot3d.source.recording import RecordedFrame, Recording
from spot3d.source.selected import Selected

S = 10**9


def recording(
    rate_hz: float, colour: ColourCamera | None = None, pose: bool = False, depth: Intrinsics = SEVEN_SCENES_DEPTH
) -> Recording:
    given = np.eye(4) if pose else None
    frames = [RecordedFrame(int(S * index / rate_hz), Path("c"), Path("d"), given) for index in range(10)]
    return Recording(frames, depth, 0.001, colour)


@pytest.mark.parametrize("halved", [False, True])
def test_a_calibration_that_nobody_stated_is_told(tmp_path: Path, halved: bool) -> None:
    taken = recording(30, load_calibration(tmp_path, SEVEN_SCENES_DEPTH))
    sequence = taken.halved() if halved else taken
    for played in (sequence, Selected(sequence, range(0, 10, 2))):
        (said,) = input_doubts(played, True)
        assert "calibration.json" in said
    (tmp_path / "calibration.json").write_text('{"registered": true}')
    assert input_doubts(recording(30, load_calibration(tmp_path, SEVEN_SCENES_DEPTH)), True) == []
    stated = ColourCamera(SEVEN_SCENES_COLOUR.intrinsics, np.eye(4))
    assert input_doubts(recording(30, stated), True) == []


def test_frames_that_are_far_apart_are_told_of_odometry_alone() -> None:
    (said,) = input_doubts(recording(1.5), True)
    assert said.startswith("frames are 0.67 s apart")
    assert "--pose truth" not in said
    (said,) = input_doubts(recording(1.5, pose=True), True)
    assert "--pose truth" in said
    assert input_doubts(recording(1.5, pose=True), False) == []
    assert input_doubts(recording(5), True) == []
    assert input_doubts(Selected(recording(30), range(0, 10, 2)), True) == []
    (said,) = input_doubts(Selected(recording(5), range(0, 10, 2)), True)
    assert "0.4 s apart" in said
