"""A run deletes the files of its stages, and nobody else's."""

from pathlib import Path

import pytest
from rich.console import Console

from spot3d.run.run import run
from spot3d.run.stage_files import delete_logs, delete_snapshots
from spot3d.settings import load_settings
from spot3d.source.selected import Selection

LOGS = ("logs/settings.toml", "logs/source.log", "logs/fusion.log")
SNAPSHOTS = (
    "snapshots/robot/fusion.snapshot",
    "snapshots/robot/fusion-before.snapshot",
    "snapshots/robot/pose.snapshot",
)
PARTIAL = "snapshots/robot/.pose.snapshot.4711.partial"


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("kept")


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_the_files_of_stages_go_with_their_folders(tmp_path: Path) -> None:
    put(tmp_path, *LOGS, *SNAPSHOTS, PARTIAL)
    delete_logs(tmp_path)
    delete_snapshots(tmp_path)
    assert files(tmp_path) == []


def test_where_there_are_none_nothing_happens(tmp_path: Path) -> None:
    delete_logs(tmp_path)
    delete_snapshots(tmp_path)
    assert files(tmp_path) == []


@pytest.mark.parametrize("in_process", [True, False])
def test_what_no_stage_has_written_stays(in_process: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    foreign = ["logs/important.log", "logs/old/source.log", "snapshots/db.bak", "snapshots/robot/holiday.jpg"]
    put(tmp_path, *foreign, *LOGS, *SNAPSHOTS)

    def stop_here(*_: object) -> None:
        raise KeyboardInterrupt

    if not in_process:
        monkeypatch.setattr("spot3d.run.run.run_distributed", stop_here)
        with pytest.raises(KeyboardInterrupt):
            run(Selection("scene", 3), load_settings(), tmp_path, Console(quiet=True))
    else:
        run(Selection("scene", 3), load_settings(), tmp_path, Console(quiet=True), in_process=True)
        assert not [name for name in (*LOGS, *SNAPSHOTS) if (tmp_path / name).exists()]
    assert [name for name in foreign if not (tmp_path / name).exists()] == []
