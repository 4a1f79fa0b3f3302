"""Which lines of TUM's lists belong together, and where colour lies in that layout."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.source.tum import nearest_in_time, open_tum


@pytest.mark.parametrize(
    ("stamps", "others", "expected"),
    [
        ([], [], []),
        ([5], [], [-1]),
        ([0], [20_000_000], [0]),
        ([0], [20_000_001], [-1]),
        ([100_000_000, 110_000_000], [95_000_000, 108_000_000], [0, 1]),
    ],
)
def test_nearest_in_time(stamps: list[int], others: list[int], expected: list[int]) -> None:
    found = nearest_in_time(np.array(stamps, np.int64), np.array(others, np.int64))
    assert found.tolist() == expected


def test_a_calibration_file_states_the_colour_camera(tmp_path: Path) -> None:
    """Of another size than depth, as the error for such colour advises."""
    assert cv2.imwrite(str(tmp_path / "colour.png"), np.full((32, 48, 3), 90, np.uint8))
    assert cv2.imwrite(str(tmp_path / "depth.png"), np.full((16, 24), 5000, np.uint16))
    (tmp_path / "rgb.txt").write_text("1.0 colour.png\n")
    (tmp_path / "depth.txt").write_text("1.0 depth.png\n")
    camera = {"fx": 40, "fy": 40, "cx": 24, "cy": 16, "width": 48, "height": 32}
    (tmp_path / "calibration.json").write_text(json.dumps({"colour": camera, "T_colour_depth": np.eye(4).tolist()}))
    frame = open_tum(tmp_path, (20, 20, 12, 8))[0]
    assert frame.colour.shape == (16, 24, 3)
    assert (frame.colour == 90).all()


def test_poses_that_are_too_far_apart_are_told_with_how_near_they_have_to_be(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert cv2.imwrite(str(tmp_path / "colour.png"), np.full((16, 24, 3), 90, np.uint8))
    assert cv2.imwrite(str(tmp_path / "depth.png"), np.full((16, 24), 5000, np.uint16))
    for name in ("rgb", "depth"):
        lines = [f"1.{tenth} {'colour' if name == 'rgb' else 'depth'}.png\n" for tenth in range(6)]
        (tmp_path / f"{name}.txt").write_text("".join(lines))
    (tmp_path / "groundtruth.txt").write_text("1.0 0 0 0 0 0 0 1\n1.5 0 0 0 0 0 0 1\n")
    open_tum(tmp_path, (20, 20, 12, 8))
    assert "4 of 6 depth images have no pose at their time; check that both use the same clock, and " in caplog.text
    assert "that poses are at most 0.25 s apart" in caplog.text
