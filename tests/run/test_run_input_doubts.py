"""What a run says of a recording before it is played."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.run.input_doubts import input_doubts
from spot3d.source.calibration import SEVEN_SCENES_COLOUR, SEVEN_SCENES_DEPTH, ColourCamera, load_calibration
from spot3d.source.recording import RecordedFrame, Recording
from spot3d.source.selected import Selected
from spot3d.source.sequences import open_source

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
    sequence = replace(taken, halved=halved)
    for played in (sequence, Selected(sequence, range(0, 10, 2))):
        (said,) = input_doubts(played, True)
        assert "calibration.json" in said
    (tmp_path / "calibration.json").write_text('{"registered": true}')
    assert input_doubts(recording(30, load_calibration(tmp_path, SEVEN_SCENES_DEPTH)), True) == []
    stated = ColourCamera(SEVEN_SCENES_COLOUR.intrinsics, np.eye(4))
    assert input_doubts(recording(30, stated), True) == []


def kitchen(folder: Path, registered: bool) -> Path:
    """8 frames of boards before a wall, with the layout and intrinsics of 7-Scenes; colour on depth, or as there."""
    folder.mkdir()
    rng, camera = np.random.default_rng(3), SEVEN_SCENES_DEPTH
    colour_camera = ColourCamera(camera, np.eye(4)) if registered else SEVEN_SCENES_COLOUR
    T, seen = colour_camera.T_colour_depth, colour_camera.intrinsics
    np.savetxt(folder / "camera-intrinsics.txt", [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    for index in range(8):
        depth, colour = np.full((480, 640), 1800, np.uint16), np.full((480, 640, 3), 120, np.uint8)
        for z in (1.5, 1.3, 1.1, 0.9, 0.7):
            left, top = rng.uniform((-0.4, -0.3), (0.2, 0.2)) * z
            corners = np.array(
                [(left, top, z), (left + 0.2, top, z), (left + 0.2, top + 0.15, z), (left, top + 0.15, z)]
            )
            at = np.rint(corners[:, :2] / z * camera.fx + (camera.cx, camera.cy)).astype(np.int32)
            cv2.fillConvexPoly(depth, at, 1000 * z)
            moved = corners @ T[:3, :3].T + T[:3, 3]
            at = np.rint(moved[:, :2] / moved[:, 2:] * seen.fx + (seen.cx, seen.cy)).astype(np.int32)
            cv2.fillConvexPoly(colour, at, rng.integers(0, 255, 3).tolist())
        cv2.imwrite(str(folder / f"frame-{index:06d}.depth.png"), depth)
        cv2.imwrite(str(folder / f"frame-{index:06d}.color.png"), colour)
    return folder


@pytest.mark.parametrize("halved", [False, True])
def test_colour_that_is_moved_rightly_is_not_told(tmp_path: Path, halved: bool) -> None:
    """Each run of 7-Scenes' own recordings said that their colour is moved, as if that were in doubt."""
    assert input_doubts(open_source(str(kitchen(tmp_path / "own", registered=False)), halved=halved), False) == []
    (said,) = input_doubts(open_source(str(kitchen(tmp_path / "other", registered=True)), halved=halved), False)
    assert 'it is already registered with depth: write {"registered": true} into calibration.json' in said


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


@pytest.mark.parametrize("odometry", [False, True])
def test_timestamps_in_another_unit_are_told(odometry: bool) -> None:
    for rate_hz, apart in ((0.03, "33"), (0.03e-3, "33,333")):
        (said,) = input_doubts(recording(rate_hz), odometry)
        assert said == f"frames are {apart} s apart by their timestamps: check that these are in seconds"
    assert not any("timestamps" in said for said in input_doubts(Selected(recording(5), range(0, 10, 9)), odometry))
