"""`bench` end to end with as little as can be measured; no time is asserted."""

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from spot3d.bench import kernels
from spot3d.bench.live import LiveRun
from spot3d.bench.material import to_and_fro
from spot3d.bench.recording import write_recording
from spot3d.bench.timing import Timed, alternate, peak_memory_mb
from spot3d.camera import Intrinsics
from spot3d.cli.bench import bench
from spot3d.cli.options import CommandError
from spot3d.evaluate.table import to_markdown
from spot3d.source.scene.scene import Scene
from spot3d.source.sequences import open_source

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(bench)

SMALL = Intrinsics(146.25, 146.25, 80.0, 60.0, 160, 120)


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small frames, one repetition."""
    monkeypatch.setattr("spot3d.source.scene.scene.Scene", lambda *words: Scene(*words, intrinsics=SMALL))
    for name in ("REPEATS", "ROUNDS", "SLOW_ROUNDS"):
        monkeypatch.setattr(kernels, name, 1)
    monkeypatch.setattr(kernels, "TRIPLES", 20)
    monkeypatch.setattr("spot3d.bench.messages.REPEATS", 1)


def measured(*words: str) -> str:
    result = CliRunner().invoke(app, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.usefixtures("hurried")
def test_tables_of_kernels_pose_messages_and_growth(tmp_path: Path) -> None:
    parts = [word for part in ("kernels", "pose", "messages", "growth") for word in ("--only", part)]
    words = ["--frames", "3", "--growth", "4", "--json", str(tmp_path / "numbers.json"), "--plots", str(tmp_path)]
    markdown = measured(*parts, *words)
    document = json.loads((tmp_path / "numbers.json").read_text())
    assert [table["table"] for table in document["tables"]] == ["kernels", "pose", "messages", "map growth"]
    for table in document["tables"]:
        assert f"### {table['title']}" in markdown
        assert all(list(row) == table["columns"] for row in table["rows"])
    steps = {row["step"] for row in document["tables"][0]["rows"]}
    assert {"plane, keyframe", "registration (index map)", "consensus, a keyframe more"} <= steps
    assert {row["size"] for row in document["tables"][0]["rows"]} == {"160x120", "80x60"}
    for row in document["tables"][0]["rows"]:
        assert row["ms"] > 0
        absent = "not installed" in row["reference"]
        assert (row["reference / ours"] is None) == absent
    assert [row["frames"] for row in document["tables"][3]["rows"]] == [4]
    assert {path.name for path in tmp_path.glob("*.png")} == {"growth-fusing.png", "growth-updates.png"}
    assert document["record"]["data"] == {"scene": "built in"}


@pytest.mark.usefixtures("hurried")
def test_what_a_live_run_reports_becomes_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    report = {
        "frames": {"input": 9, "fused": 7, "skipped": {"no heat": 2}},
        "drops": {"proposals": {"source/frame busy": 2}},
        "latency_ms": {"source to fused": {"p50": 41.0, "p99": 77.0}},
        "stages": {"fusion": {"cpu_s": 0.3, "rss_mb": 222.0}, "pose": {"cpu_s": None, "rss_mb": None}},
    }
    runs = iter([LiveRun(2.5, 29.9, 1.5, 7, report), LiveRun(error="fusion: it broke")])
    monkeypatch.setattr("spot3d.bench.live.live_run", lambda *_: next(runs))
    markdown = measured("--only", "live", "--frames", "2")
    good, bad = (line for line in markdown.splitlines() if line.startswith("| scene"))
    cells = [cell.strip() for cell in good.strip("|").split("|")]
    assert cells[:6] == ["scene", "160x120", "30.0", "29.9", "9", "7"]
    assert cells[6:] == ["41", "77", "2.5", "1.50", "222", "2 no heat", "2 proposals"]
    assert "-" in bad
    assert "it broke" in markdown


def test_an_unknown_part_is_refused() -> None:
    with pytest.raises(CommandError, match="choose from kernels, pose"):
        CliRunner().invoke(app, ["--only", "nothing"], catch_exceptions=False)


def test_calls_are_measured_in_turn() -> None:
    order: list[str] = []
    alternate([Timed(lambda: order.append("a"), 2), Timed(lambda: order.append("b"), 1)], 2)
    assert "".join(order) == "a" + "aab" * 2
    assert peak_memory_mb() > 1


@pytest.mark.parametrize(("count", "walk"), [(1, [0, 0, 0]), (2, [0, 1, 0]), (4, [0, 1, 2, 3, 2, 1, 0, 1])])
def test_a_walk_goes_to_and_fro(count: int, walk: list[int]) -> None:
    assert [to_and_fro(count, step) for step in range(len(walk))] == walk


def test_a_written_recording_plays_the_same_frames(tmp_path: Path) -> None:
    frames = list(Scene(frames=3, intrinsics=SMALL))
    write_recording(tmp_path / "walk", frames, 6)
    opened = open_source(tmp_path / "walk")
    assert len(opened) == 6
    for index, number in enumerate([0, 1, 2, 1, 0, 1]):
        np.testing.assert_array_equal(opened[index].colour, frames[number].colour)
        np.testing.assert_allclose(opened[index].depth_metres(), frames[number].depth_metres(), atol=1e-6)
        np.testing.assert_allclose(opened[index].T_world_camera, frames[number].T_world_camera, atol=1e-6)


def test_an_empty_table_has_its_heads() -> None:
    empty = kernels.kernels_table([], None, print)
    assert "| reference / ours |" in to_markdown(empty).replace("  ", " ")
