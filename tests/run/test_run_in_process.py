"""A run without processes: what a core's failure costs it."""

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from spot3d import pipeline
from spot3d.run.run import run
from spot3d.settings import load_settings
from spot3d.source.selected import Selection

FRAMES = 3
SAID = "no proposals for the frame at 66666666 ns: ValueError: odd"


@pytest.mark.parametrize(("failures", "error"), [(1, ""), (FRAMES, f"proposals failed on every frame: {SAID}")])
def test_single_failures_are_counted_and_a_core_that_only_fails_makes_no_success(
    failures: int, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    works, left = pipeline.propose, iter(range(FRAMES))

    def fails_in_the_end(*given: Any) -> Any:
        if next(left) >= FRAMES - failures:
            raise ValueError("odd")
        return works(*given)

    monkeypatch.setattr(pipeline, "propose", fails_in_the_end)
    settings = load_settings(overrides={"source": {"halved": True}, "pose": {"provider": "given"}})
    done = run(Selection("scene", FRAMES), settings, tmp_path, Console(quiet=True), in_process=True)
    assert done.report.error == error
    assert done.report.fused == FRAMES
    document = json.loads((tmp_path / "report.json").read_text())
    stage = document["stages"]["proposals"]
    assert (stage["errors"], stage["last_error"], document["error"]) == (failures, SAID, error or None)
