"""`spot3d run` on a camera whose depth is too long for the given poses: what a person and a program are told."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.settings import without_settings
from spot3d.source.scene.scene import Scene

CAMERA = Intrinsics(146.25, 146.25, 80.0, 60.0, 160, 120)
FRAMES, FACTOR = 180, 1.04
LIMIT_S = 180.0
"""A first start may compile kernels."""


@pytest.fixture(scope="module")
def too_long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the built-in scene in the layout of 7-Scenes, its depth 4 % too long."""
    folder = tmp_path_factory.mktemp("too_long")
    scene = Scene(0, frames=FRAMES, intrinsics=CAMERA)
    for number, frame in enumerate(scene):
        name = folder / f"frame-{number:06d}"
        depth = np.rint(1000 * FACTOR * frame.depth_metres()).astype(np.uint16)
        assert cv2.imwrite(f"{name}.color.png", frame.colour[..., ::-1])
        assert cv2.imwrite(f"{name}.depth.png", depth)
        np.savetxt(f"{name}.pose.txt", scene.true_pose(number))
    k = CAMERA
    np.savetxt(folder / "camera-intrinsics.txt", [[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]])
    return folder


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_run_says_that_depth_is_too_long(too_long: Path, tmp_path: Path, more: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "spot3d", "run", str(too_long), "--pose", "given", "--out", str(tmp_path), *more]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=LIMIT_S, check=False, env=without_settings(os.environ)
    )
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["depth_factor"] == pytest.approx(1 / FACTOR, abs=0.011)
    said = re.search(r"^depth is ([\d.]+)% too long for the given poses", done.stdout, re.MULTILINE)
    assert said is not None, done.stdout
    assert 0.01 * float(said[1]) == pytest.approx(1 / report["depth_factor"] - 1, abs=0.002)
    if not more:
        assert report["stages"]["pose"]["events"]["depth's scale"] >= 1
        assert "too long for the given poses" in (tmp_path / "logs" / "pose.log").read_text()
