"""What is in a run's folder while it goes on."""

import errno
import io
import json
import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from spot3d.run.dashboard_process import DashboardProcess
from spot3d.run.run import run
from spot3d.run.sole_writer import sole_writer
from spot3d.settings import load_settings
from spot3d.source.errors import SourceError
from spot3d.source.selected import Selection


class StartedError(Exception):
    """The stages would be started now."""


@pytest.mark.parametrize("in_process", [True, False])
def test_nothing_of_an_earlier_run_is_there_when_the_stages_start(
    in_process: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(*_: object) -> None:
        raise StartedError

    monkeypatch.setattr("spot3d.run.in_process.run_in_process", start)
    monkeypatch.setattr("spot3d.run.run.run_distributed", start)
    for name in ("objects.json", "objects.jsonl", "heatmap.ply", "overview.png", "trajectory.txt"):
        (tmp_path / name).write_text("of the run before")
    for name in ("streams/1/trajectory.txt", "streams/1/objects.json", "streams/2022/walk.bag", "streams/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("of the run before")
    (tmp_path / "report.json").write_text('{"error": null}')
    with pytest.raises(StartedError):
        run(Selection("scene", 3), load_settings(), tmp_path, Console(quiet=True), in_process)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["error"] == "the run is still in progress, was killed, or could not begin"
    assert (report["input"], report["frames"]["fused"]) == ("scene", 0)
    left = {path.name for path in tmp_path.iterdir() if path.is_file() and path.read_text() == "of the run before"}
    assert not left
    kept = sorted(path.name for path in (tmp_path / "streams").rglob("*"))
    assert kept == ["2022", "notes.txt", "walk.bag"], "what no run has written is nobody's to delete"
    assert not [name for name in ("objects.json", "heatmap.ply", "overview.png") if (tmp_path / name).exists()]


def test_a_run_that_is_ended_while_it_looks_at_its_input_leaves_the_results_of_the_run_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("spot3d.run.run.input_doubts", interrupt)
    for name in ("objects.json", "report.json", "settings.toml"):
        (tmp_path / name).write_text("of the run before")
    with pytest.raises(KeyboardInterrupt):
        run(Selection("scene", 3), load_settings(), tmp_path, Console(quiet=True), in_process=True)
    for name in ("objects.json", "report.json", "settings.toml"):
        assert (tmp_path / name).read_text() == "of the run before"


def test_a_camera_without_its_sdk_is_refused_and_leaves_the_results_of_the_run_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(*_: object) -> None:
        raise StartedError

    monkeypatch.setattr("spot3d.run.run.run_distributed", start)
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    (tmp_path / "objects.json").write_text("of the run before")
    with pytest.raises(SourceError, match=r"which is not installed: pip install 'spot3d\[realsense\]'"):
        run(Selection("realsense"), load_settings(), tmp_path, Console(quiet=True))
    assert [path.name for path in tmp_path.iterdir()] == ["objects.json"]


@pytest.mark.parametrize("in_process", [True, False])
@pytest.mark.parametrize(("provider", "package"), [("kiss", "kiss_icp"), ("gicp", "small_gicp"), ("given", "scipy")])
def test_a_run_whose_stages_lack_a_package_leaves_the_results_of_the_run_before(
    provider: str, package: str, in_process: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(*_: object) -> None:
        raise StartedError

    monkeypatch.setattr("spot3d.run.in_process.run_in_process", start)
    monkeypatch.setattr("spot3d.run.run.run_distributed", start)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "objects.json").write_text("of the run before")
    settings = load_settings(overrides={"pose": {"provider": provider}})
    with pytest.raises(ModuleNotFoundError, match=package):
        run(Selection("scene", 3), settings, tmp_path, Console(quiet=True), in_process)
    assert [path.name for path in tmp_path.iterdir()] == ["objects.json"]


def test_a_report_has_the_whole_path_of_its_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An export from another folder would take the images of whatever has that name there."""
    kitchen = tmp_path / "kitchen"
    kitchen.mkdir()
    for name, image in (("color", np.zeros((48, 64, 3), np.uint8)), ("depth", np.full((48, 64), 1500, np.uint16))):
        assert cv2.imwrite(str(kitchen / f"frame-000000.{name}.png"), image)
    monkeypatch.chdir(tmp_path)
    chosen = Selection("kitchen", intrinsics=(58.0, 58.0, 31.5, 23.5))
    run(chosen, load_settings(), tmp_path / "out", Console(quiet=True), in_process=True)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["input"], report["selection"]["name"]) == ("kitchen", str(kitchen))


def test_a_report_tells_of_results_that_could_not_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not that all is well: it is written last."""
    told = []

    def full(*_: object) -> None:
        told.append(json.loads((tmp_path / "report.json").read_text())["error"])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("spot3d.run.run.write_overview", full)
    with pytest.raises(OSError, match="No space"):
        run(Selection("scene", 3), load_settings(), tmp_path, Console(quiet=True), in_process=True)
    report = json.loads((tmp_path / "report.json").read_text())
    assert told == ["the run is still in progress, was killed, or could not begin"]
    assert report["error"].startswith("cannot write all results: ")
    assert report["frames"]["fused"] == 3


def test_a_picture_that_cannot_be_drawn_costs_no_other_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise TypeError("no hull")

    monkeypatch.setattr("spot3d.run.overview.draw_overview", fail)
    run(Selection("scene", 3), load_settings(), tmp_path, Console(quiet=True), in_process=True)
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["error"], report["frames"]["fused"]) == (None, 3)
    assert "overview.png cannot be drawn: TypeError: no hull" in report["events"]


def test_no_dashboard_of_a_run_that_is_refused_is_started(tmp_path: Path) -> None:
    """Its log would replace another run's, and the browser show nothing."""
    refused = (
        (Selection("scene"), load_settings(overrides={"pose": {"provider": "given"}}), "another run writes into"),
        (Selection(str(tmp_path / "no such folder")), load_settings(), "no such folder does not exist"),
    )
    for selection, settings, why in refused:
        page = DashboardProcess("robot", None, tmp_path / "dashboard.log", Console(quiet=True))
        with sole_writer(tmp_path), pytest.raises(SourceError, match=why):
            run(selection, settings, tmp_path, Console(quiet=True), accepted=page.start)
        page.close()
    assert not list(tmp_path.iterdir())


def test_a_dashboard_that_has_ended_by_itself_says_where_to_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = io.StringIO()
    page = DashboardProcess("robot", None, tmp_path / "dashboard.log", Console(file=text, width=200))
    monkeypatch.setattr(page, "_command", [sys.executable, "-c", "pass"])
    page.start()
    page.close()
    page.keep()
    assert "stays until Ctrl-C" not in text.getvalue()
    assert f"has ended; see {tmp_path / 'dashboard.log'}" in text.getvalue()
