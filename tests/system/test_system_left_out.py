"""What was left out is told by processes as by one process."""

import json
from pathlib import Path

from commands import spot3d

NARROW = {"SPOT3D_FUSION__SIZE_MAX": "0.04", "SPOT3D_FUSION__KEYFRAME_LIMIT": "1"}
"""Settings by which nothing on the table is an object, and one keyframe of two is forgotten."""


def told(out: Path, *more: str) -> tuple[str, dict[str, object]]:
    """What a run of 12 frames prints, and its report."""
    done = spot3d("run", "scene", "--half", "--frames", "12", "--out", str(out), *more, **NARROW)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads((out / "report.json").read_text())


def test_an_empty_result_is_explained_alike_by_processes_and_by_one(tmp_path: Path) -> None:
    said, alone = told(tmp_path / "alone", "--in-process")
    said_together, together = told(tmp_path / "together")
    objects = alone["objects"]
    assert objects == together["objects"]
    assert alone["keyframes_dropped"] == together["keyframes_dropped"] == 1
    assert isinstance(objects, dict)
    assert objects["found"] == 0
    count = objects["left_out"]["too large"]
    lines = [line for line in said.splitlines() if line.startswith(("no objects: ", "the first "))]
    assert f"{count} candidates were longer than 0.04 m (eps_max)" in lines[0]
    assert "the first keyframe was forgotten" in lines[1]
    assert all(line in said_together.splitlines() for line in lines)
