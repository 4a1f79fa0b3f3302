"""`spot3d run` of a camera that hangs on its side: a person and a program are told, once, what to set."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.settings import without_settings
from spot3d.source.scene.scene import Scene

CAMERA = Intrinsics(146.25, 146.25, 80.0, 60.0, 160, 120)
RATE, SECONDS, STEP = 30, 8, 3
LIMIT_S = 180.0
"""A first start may compile kernels."""
EVENT = "left side seems up"


@pytest.fixture(scope="module")
def on_its_side(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built-in scene in the layout of 7-Scenes, whose images are turned by 90 degrees to the left."""
    folder = tmp_path_factory.mktemp("on_its_side")
    scene, quarter = Scene(0, frames=RATE * SECONDS, intrinsics=CAMERA), np.eye(4)
    quarter[:2, :2] = (0, -1), (1, 0)
    for number in range(0, len(scene), STEP):
        frame, name = scene[number], folder / f"frame-{number:06d}"
        assert cv2.imwrite(f"{name}.color.png", np.rot90(frame.colour)[..., ::-1])
        assert cv2.imwrite(f"{name}.depth.png", np.rint(1000 * np.rot90(frame.depth_metres())).astype(np.uint16))
        np.savetxt(f"{name}.pose.txt", scene.true_pose(number) @ quarter)
    k = CAMERA
    np.savetxt(folder / "camera-intrinsics.txt", [[k.fy, 0, k.cy], [0, k.fx, k.width - 1 - k.cx], [0, 0, 1]])
    return folder


def run(recording: Path, out: Path, *more: str) -> tuple[list[str], dict[str, Any]]:
    """The lines that `spot3d run` prints of which side is up, and its report."""
    command = [sys.executable, "-m", "spot3d", "run", str(recording), "--pose", "given", "--out", str(out), *more]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=LIMIT_S, check=False, env=without_settings(os.environ)
    )
    assert done.returncode == 0, done.stderr
    said = [line for line in (done.stdout + done.stderr).splitlines() if "seems to be up" in line]
    return said, json.loads((out / "report.json").read_text())


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_run_says_that_another_side_of_the_image_is_up(on_its_side: Path, tmp_path: Path, more: tuple[str]) -> None:
    said, report = run(on_its_side, tmp_path, *more)
    assert len(said) == 1
    assert 'set segments.image_up = "left"' in said[0]
    assert said == [text for text in report["events"] if "seems to be up" in text]
    assert report["stages"]["segments"]["events"][EVENT] == 1
    if not more:
        assert said[0] in (tmp_path / "logs" / "segments.log").read_text()


def test_a_run_whose_settings_say_so_is_not_told(on_its_side: Path, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text('[segments]\nimage_up = "left"\n')
    said, report = run(on_its_side, tmp_path / "out", "--in-process", "--settings", str(settings))
    assert (said, report["events"]) == ([], [])
