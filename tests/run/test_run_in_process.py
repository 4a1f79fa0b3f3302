"""A run without processes: what a core's failure costs it, and what it asks of its input."""

import json
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from spot3d import pipeline
from spot3d.frame import RgbdFrame
from spot3d.pose.estimate import GIVEN_JUMPED
from spot3d.run.display import RunMonitor
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.in_process import run_in_process
from spot3d.run.report import RunReport
from spot3d.run.run import run
from spot3d.settings import load_settings
from spot3d.source.selected import Selection, open_selection
from spot3d.source.sequence import Derived

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


class SearchedScene(Derived):
    """Counts how often its poses are searched for."""

    searched = 0

    @property
    def has_true_poses(self) -> bool:
        self.searched += 1
        return True

    def __getitem__(self, index: int) -> RgbdFrame:
        return self.original[index]


def test_an_input_is_searched_for_poses_once(tmp_path: Path) -> None:
    settings = load_settings(overrides={"source": {"halved": True}, "pose": {"provider": "given"}})
    scene = SearchedScene(open_selection(Selection("scene", FRAMES), settings.source))
    watcher = SimpleNamespace(on_progress=lambda *_: None, on_event=pytest.fail)
    report = RunReport("scene", "in process", FRAMES, (320, 240))
    with GrowingFiles(tmp_path) as files:
        run_in_process(scene, settings, RunMonitor(report, files, watcher, Event()))
    assert report.fused == FRAMES
    assert scene.searched == 1


class JumpingScene(Derived):
    """Its poses jump by more than a metre, as those of a tracker that begins anew."""

    def __getitem__(self, index: int) -> RgbdFrame:
        frame = self.original[index]
        assert frame.T_world_camera is not None
        moved = frame.T_world_camera.copy()
        moved[0, 3] += 1.5 * (index >= FRAMES)
        return replace(frame, T_world_camera=moved)


def test_given_poses_that_jump_are_counted(tmp_path: Path) -> None:
    settings = load_settings(overrides={"source": {"halved": True}, "pose": {"provider": "given"}})
    scene = JumpingScene(open_selection(Selection("scene", 2 * FRAMES), settings.source))
    watcher = SimpleNamespace(on_progress=lambda *_: None, on_event=pytest.fail)
    report = RunReport("scene", "in process", 2 * FRAMES, (320, 240))
    with GrowingFiles(tmp_path) as files:
        run_in_process(scene, settings, RunMonitor(report, files, watcher, Event()))
    assert report.stages["pose"].events == {GIVEN_JUMPED: 1}


class FarScene(Derived):
    """Its poses are in a map's grid, such as UTM."""

    def __getitem__(self, index: int) -> RgbdFrame:
        grid = np.eye(4)
        grid[:2, 3] = 4.5e5, 5.4e6
        return replace(self.original[index], T_world_camera=grid)


def test_odometry_in_a_grid_that_no_map_reaches_is_fused_and_tells_where_its_world_begins(tmp_path: Path) -> None:
    settings = load_settings(overrides={"source": {"halved": True}, "pose": {"provider": "kiss"}})
    scene = FarScene(open_selection(Selection("scene", 30), settings.source))
    told: list[str] = []
    report, stop = RunReport("scene", "in process", FRAMES, (320, 240)), Event()
    watcher = SimpleNamespace(
        on_progress=lambda fused, *_: stop.set() if fused == FRAMES else None, on_event=told.append
    )
    with GrowingFiles(tmp_path) as files:
        run_in_process(scene, settings, RunMonitor(report, files, watcher, stop))
    assert report.fused == FRAMES
    (said,) = [text for text in told if "given pose" in text]
    assert "beyond the map's 2000 m from the origin: the world begins at the first camera instead" in said
