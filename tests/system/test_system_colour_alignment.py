"""A run says once that colour lies off depth, and goes on."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spot3d.bench.recording import write_recording
from spot3d.settings import without_settings
from spot3d.source.sequences import open_source

FRAMES, LIMIT_S = 130, 180.0
TOLD = "colour lies off depth"


def recording(folder: Path, right: int) -> Path:
    """Frames of the built-in scene, colour moved by so many pixels of 320."""
    frames = open_source("scene:0", FRAMES, halved=True)
    moved = [replace(frame, colour=np.roll(frame.colour, right, axis=1)) for frame in frames]
    write_recording(folder, moved, FRAMES)
    return folder


@pytest.mark.parametrize(("right", "times", "more"), [(0, 0, []), (16, 1, []), (16, 1, ["--in-process"])])
def test_a_run_says_that_colour_lies_off_depth(tmp_path: Path, right: int, times: int, more: list[str]) -> None:
    out = tmp_path / "out"
    arguments = ["run", str(recording(tmp_path / "in", right)), "--out", str(out), "--pose", "truth", *more]
    done = subprocess.run(
        [sys.executable, "-m", "spot3d", *arguments],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
        env=without_settings(os.environ),
    )
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert done.stdout.count(TOLD) == times
    assert report["stages"]["proposals"]["events"].get(TOLD, 0) == times
    told = [text for text in report["events"] if TOLD in text]
    assert [text.partition(":")[0] for text in told] == [f"{TOLD}, by about {right} pixels right"] * times
