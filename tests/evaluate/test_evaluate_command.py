"""`evaluate` end to end on the built-in scene and a made-up data set, with a handful of frames."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from evaluate_samples import write_osd, write_uw_scenes
from typer.testing import CliRunner

from spot3d import pipeline
from spot3d.boxes import moved
from spot3d.cli.evaluate import evaluate
from spot3d.cli.options import CommandError
from spot3d.evaluate.cost_tables import TIMED
from spot3d.evaluate.datasets import at_half_size, open_dataset
from spot3d.evaluate.measured_run import Runs, world_alignment
from spot3d.evaluate.object_tables import OURS, ablations
from spot3d.evaluate.peer import PEER
from spot3d.evaluate.robustness import SHAKES
from spot3d.evaluate.tables import SHORT_TABLES
from spot3d.found_object import FoundObject
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.results import RunResult, write_results
from spot3d.settings import Settings, load_settings
from spot3d.source.errors import SourceError

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(evaluate)

FRAMES = 2
METHODS = [OURS, PEER]


@pytest.fixture(scope="module")
def all_tables(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any], Path]:
    """Markdown, JSON and plots of every table for two frames of a scene."""
    folder = tmp_path_factory.mktemp("tables")
    (folder / "empty").mkdir()
    words = ["all", str(folder / "empty"), "--every", "12", "--frames", str(FRAMES), "--half"]
    words += ["--json", str(folder / "numbers.json"), "--plots", str(folder)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spot3d.cli.evaluate.BUILT_IN", ("scene:2",))
        patch.setattr("spot3d.evaluate.frame_tables.NUMBERS", (50, 100))
        result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout, json.loads((folder / "numbers.json").read_text()), folder


def test_markdown_and_json_say_the_same(all_tables: tuple[str, dict[str, Any], Path]) -> None:
    markdown, document, _ = all_tables
    assert [made["table"] for made in document["tables"]] == SHORT_TABLES
    parts = markdown.split("### ")[1:]
    for part, made in zip(parts, document["tables"], strict=True):
        lines = [line for line in part.splitlines() if line.startswith("|")]
        assert len(lines) == 2 + len(made["rows"])
        assert {line.count("|") for line in lines} == {len(made["columns"]) + 1}
        assert all(list(row) == made["columns"] for row in made["rows"])


def test_rows_of_each_table(all_tables: tuple[str, dict[str, Any], Path]) -> None:
    rows = {made["table"]: made["rows"] for made in all_tables[1]["tables"]}
    assert [row["proposals"] for row in rows["proposals"]] == [50, 100]
    assert [row["method"] for row in rows["ablations"]] == [*ablations(Settings()), PEER]
    assert rows["objects"][0]["size"] == "320x240"
    assert [row["method"] for row in rows["objects"]] == [row["method"] for row in rows["points"]] == METHODS
    for overlap in rows["objects"]:
        assert overlap["left out"] == 0, "the scene's labels ignore nothing"
        assert overlap["3D SR all"] == overlap["3D SR"]
        assert overlap["carried DR"] == overlap["3D DR"], "given poses bend nothing"
        assert 0 <= overlap["no object"] <= overlap["found"]
    for points in rows["points"]:
        assert points["carried F"] == pytest.approx(points["F"], abs=0.5)
    assert {row["peer DR"] for row in rows["proposals"]} == {rows["proposals"][0]["peer DR"]}
    (still,) = rows["still"]
    assert still["ours DR"] > still["peer DR"] > 0
    assert still["true a frame"] == rows["proposals"][0]["true a frame"]
    for row in rows["filters"]:
        assert row["accepted %"] + row["masked in part %"] + row["rejected %"] == pytest.approx(100)
    (times,) = rows["time"]
    assert times["all ms"] == pytest.approx(sum(times[f"{stage} ms"] for stage in TIMED))
    assert min(times["proposals ms"], times["heatmap ms"], times["fusion ms"]) > 0
    assert len(rows["stability"]) == rows["objects"][0]["true"]
    assert {row["provider"] for row in rows["poses"]} >= {"kiss"}
    notes = {made["table"]: made["notes"] for made in all_tables[1]["tables"]}
    assert "ids given in 1 updates" in notes["stability"][0]


def test_single_frames_as_a_moving_camera_sees_them(tmp_path: Path) -> None:
    words = ["moving", "scene:2", "--frames", "1", "--half", "--json", str(tmp_path / "numbers.json")]
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0
    (made,) = json.loads((tmp_path / "numbers.json").read_text())["tables"]
    shakes = [f"{1e3 * metres:g} mm {degrees:g} deg" for metres, degrees in SHAKES]
    assert [row["poses"] for row in made["rows"]] == ["true", *shakes, "KISS-ICP"]
    for row in made["rows"]:
        assert row["ours DR"] > 0.5, row["poses"]
    true, *_, worst, _ = made["rows"]
    assert true["peer DR"] > worst["peer DR"], "its clusters are of points where the told poses have them"


def test_record_and_plots(all_tables: tuple[str, dict[str, Any], Path]) -> None:
    _, document, folder = all_tables
    kept = document["record"]
    assert {"version", "machine", "options", "data", "settings"} == set(kept)
    assert (kept["options"]["every"], kept["data"]) == (12, {"scene:2": "built in"})
    assert kept["settings"]["pose"]["provider"] == "given"
    plots = {f"{name}-scene-2.png" for name in ("proposals", "still", "objects")}
    assert {path.name for path in folder.glob("*.png")} == plots


def test_all_tables_of_what_is_below_a_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_osd(tmp_path / "osd")
    write_uw_scenes(tmp_path / "uw")
    (tmp_path / "uw" / "pc" / "01.ply").unlink()
    monkeypatch.setattr("spot3d.cli.evaluate.BUILT_IN", ())
    result = CliRunner().invoke(app, ["all", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    assert result.stdout.count("###") == 4, "single frames give the tables of proposals, still, steps and filters"
    assert "left out" in result.stderr
    assert "01.ply is missing" in result.stderr


@pytest.mark.parametrize(
    ("table", "message"), [("points", "labelled cloud"), ("poses", "true poses"), ("ablations", "true objects")]
)
def test_a_table_says_what_data_it_needs(tmp_path: Path, table: str, message: str) -> None:
    write_osd(tmp_path)
    with pytest.raises(SourceError, match=message):
        CliRunner().invoke(app, [table, str(tmp_path)], catch_exceptions=False)


def test_unknown_table(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["tables", str(tmp_path)])
    assert "there is no table 'tables'" in str(result.exception)


def test_runs_are_shared() -> None:
    said: list[str] = []
    runs, settings = Runs(said.append), load_settings(overrides={"pose": {"provider": "given"}})
    (item,) = at_half_size(open_dataset("scene", settings, frames=1)).sequences
    assert runs.run(item, settings) is runs.run(item, settings)
    other = ablations(settings)["noPlRem"]
    assert runs.run(item, other) is not runs.run(item, settings)
    assert len(said) == 2


def test_ablations_change_what_they_say() -> None:
    whole = Settings()
    variants = ablations(whole)
    ours = ["noFlying", "noRecent", "noShare", "noCorr"]
    steps = [name for name in variants if name.startswith("without ")]
    assert list(variants) == ["noHmap", "noSFilt", "noHFilt", "noPlRem", *ours, *steps, "whole"]
    assert variants["whole"] == whole
    assert variants["without torn"].segments.skipped == ("torn",)
    assert variants["without disputed"].fusion.skipped == ("disputed",)
    assert len({settings.model_dump_json() for settings in variants.values()}) == len(variants)
    filters = {name: (s.heatmap.soft_filter, s.heatmap.hard_filter) for name, s in variants.items()}
    assert filters["noHmap"] == (False, False)
    assert filters["noSFilt"] == (False, True)
    assert filters["noHFilt"] == (True, False)
    assert [name for name, s in variants.items() if not s.fusion.plane_removal] == ["noPlRem"]
    assert not variants["noHFilt"].proposals.metric_culling, "culling is the hard filter, applied earlier"


def test_odometry_is_measured_in_the_true_world() -> None:
    """Whatever world the poses found are in, the alignment brings them onto the true ones."""
    sequence = open_dataset("scene", Settings(), every=20, frames=4).sequences[0].sequence
    T_found_true = np.array([[0, -1, 0, 1], [0, 0, -1, 2], [1, 0, 0, 3], [0, 0, 0, 1]], np.float64)
    tracked = [(stamp, T_found_true @ sequence.true_pose(index)) for index, stamp in enumerate(sequence.stamps_ns)]
    T = world_alignment(sequence, [*tracked, (-1, np.eye(4))])
    np.testing.assert_allclose(T @ T_found_true, np.eye(4), atol=1e-9)
    with pytest.raises(SourceError, match="no frame has both"):
        world_alignment(sequence, [(-1, np.eye(4))])


def test_a_finished_run_is_measured_from_its_folder(tmp_path: Path) -> None:
    scene = open_dataset("scene:3", Settings(), every=20, frames=4)
    sequence, truth = scene.sequences[0].sequence, scene.sequences[0].truth
    assert truth is not None
    T_found_true = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], np.float64)
    found = [FoundObject(k + 1, moved(box, T_found_true), 0.5, 9, 100) for k, box in enumerate(truth.boxes)]
    stamps = sequence.stamps_ns
    path = [(stamps[index], T_found_true @ sequence.true_pose(index)) for index in range(4) if index != 2]
    write_results(tmp_path, RunResult(tuple(found[1:])))
    with GrowingFiles(tmp_path) as files:
        for stamp_ns, T_world_camera in path:
            files.add_pose(stamp_ns, T_world_camera)
    words = ["run", "scene:3", "--of", str(tmp_path), "--json", str(tmp_path / "numbers.json")]

    def rows(depth_factor: float, centre: float = 0.0) -> list[dict[str, Any]]:
        (tmp_path / "report.json").write_text(json.dumps({"depth_factor": depth_factor, "centre": [0.0, centre]}))
        assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0
        made: list[dict[str, Any]] = json.loads((tmp_path / "numbers.json").read_text())["tables"][0]["rows"]
        return made

    assert rows(1.2)[1]["3D IoU"] < rows(1.0)[1]["3D IoU"], "the peer sees depth as the run has corrected it"
    assert rows(1.0, 0.2)[1]["3D IoU"] < rows(1.0)[1]["3D IoU"], "and the principal point"
    row, peer = rows(1.0)
    assert [row["method"], peer["method"]] == METHODS
    count = len(found)
    assert (row["poses"], row["found"], row["true"], row["left out"]) == (3, count - 1, count, 0)
    assert row["3D DR"] == pytest.approx((count - 1) / count)
    assert (row["3D SR"], row["3D IoU_o"]) == pytest.approx((1, 1))
    assert row["AP"] == row["AP all"] > 90
    assert row["carried AP"] > 90
    assert row["carried IoU"] == pytest.approx(row["3D IoU"])
    assert (row["no object"], row["carried SR"]) == (0, pytest.approx(1))


def test_intrinsics_are_of_one_data_set(tmp_path: Path) -> None:
    write_osd(tmp_path)
    words = ["filters", str(tmp_path), "--intrinsics", "60,61,32,24", "--json", str(tmp_path / "numbers.json")]
    assert CliRunner().invoke(app, words, catch_exceptions=False).exit_code == 0
    assert json.loads((tmp_path / "numbers.json").read_text())["record"]["options"]["intrinsics"] == "60,61,32,24"
    result = CliRunner().invoke(app, ["all", str(tmp_path), "--intrinsics", "60,61,32,24"])
    assert "one data set;" in str(result.exception)


def test_a_finished_run_of_data_without_truth_is_refused(tmp_path: Path) -> None:
    write_osd(tmp_path)
    with pytest.raises(SourceError, match="has no sequence with both true objects and true poses"):
        CliRunner().invoke(app, ["run", str(tmp_path), "--of", str(tmp_path)], catch_exceptions=False)


@pytest.mark.parametrize("words", [["run", "scene:3"], ["points", "scene:3", "--of", "out"]])
def test_a_run_is_asked_for_in_one_way(words: list[str]) -> None:
    result = CliRunner().invoke(app, words)
    assert "spot3d evaluate run PATH --of FOLDER" in str(result.exception)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"does not contain a finished run: cannot use .*trajectory.txt: it, or"):
        CliRunner().invoke(app, ["run", "scene:3", "--of", str(tmp_path)], catch_exceptions=False)


@pytest.mark.parametrize("table", ["objects", "robustness"])
def test_a_stage_that_fails_is_told_in_a_line(table: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> None:
        raise ValueError("one odd frame")

    monkeypatch.setattr(pipeline, "weighted_heat", fails)
    failed = CliRunner().invoke(app, [table, "scene:2", "--frames", "2", "--half"]).exception
    assert isinstance(failed, CommandError)
    assert "2 of heatmap, the last one: no heat for" in str(failed)
