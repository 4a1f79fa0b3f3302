"""`spot3d run` where depth is too long for the given poses, or these are late: what a person and a program are told."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from commands import spot3d
from spot3d.camera import Intrinsics
from spot3d.source.scene.scene import Scene

CAMERA = Intrinsics(146.25, 146.25, 80.0, 60.0, 160, 120)
RATE, SECONDS = 30, 6
FACTOR, LATE = 1.04, 3


def recorded(folder: Path, seconds: int, step: int = 1, factor: float = 1.0, late: int = 0) -> Path:
    """The built-in scene in the layout of 7-Scenes, every nth frame.

    Its depth is times `factor`, its poses are those of so many frames before.
    """
    scene = Scene(0, frames=RATE * seconds, intrinsics=CAMERA)
    for number in range(late, len(scene), step):
        frame, name = scene[number], folder / f"frame-{number:06d}"
        depth = np.rint(1000 * factor * frame.depth_metres()).astype(np.uint16)
        assert cv2.imwrite(f"{name}.color.png", frame.colour[..., ::-1])
        assert cv2.imwrite(f"{name}.depth.png", depth)
        np.savetxt(f"{name}.pose.txt", scene.true_pose(number - late))
    k = CAMERA
    np.savetxt(folder / "camera-intrinsics.txt", [[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]])
    return folder


@pytest.fixture(scope="module")
def too_long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds whose depth is 4 % too long."""
    return recorded(tmp_path_factory.mktemp("too_long"), SECONDS, factor=FACTOR)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine seconds whose poses are a tenth of a second late."""
    return recorded(tmp_path_factory.mktemp("late"), 9, step=3, late=LATE)


def run(recording: Path, out: Path, *more: str) -> tuple[str, dict[str, Any]]:
    """What `spot3d run` prints, and its report."""
    done = spot3d("run", str(recording), "--pose", "given", "--out", str(out), *more)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads((out / "report.json").read_text())


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_run_says_that_depth_is_too_long(too_long: Path, tmp_path: Path, more: tuple[str, ...]) -> None:
    stdout, report = run(too_long, tmp_path, *more)
    assert report["depth_factor"] == pytest.approx(1 / FACTOR, abs=0.011)
    assert report["delay_s"] == pytest.approx(0, abs=0.005)
    assert report["turn_deg"] == pytest.approx([0, 0, 0], abs=0.3)
    assert report["centre"] == pytest.approx([0, 0], abs=0.005)
    said = re.search(r"^depth is ([\d.]+)% too long for the given poses", stdout, re.MULTILINE)
    assert said is not None, stdout
    assert 0.01 * float(said[1]) == pytest.approx(1 / report["depth_factor"] - 1, abs=0.002)
    if not more:
        assert report["stages"]["pose"]["events"]["depth's scale"] >= 1
        assert "too long for the given poses" in (tmp_path / "logs" / "pose.log").read_text()


def test_a_run_says_that_poses_are_late(late: Path, tmp_path: Path) -> None:
    alone, together = tmp_path / "alone", tmp_path / "together"
    for out, more in ((alone, ("--in-process",)), (together, ())):
        stdout, report = run(late, out, *more)
        assert report["delay_s"] == pytest.approx(LATE / RATE, rel=0.4)
        said = re.search(
            r"^given poses are (\d+) ms older than their images; .* check the timestamps", stdout, re.MULTILINE
        )
        assert said is not None, stdout
        assert 0.001 * float(said[1]) == pytest.approx(report["delay_s"], abs=0.001)
    assert report["stages"]["pose"]["events"]["poses' delay"] >= 1
    assert "older than their images" in (together / "logs" / "pose.log").read_text()
    assert (alone / "objects.jsonl").read_bytes() == (together / "objects.jsonl").read_bytes()
