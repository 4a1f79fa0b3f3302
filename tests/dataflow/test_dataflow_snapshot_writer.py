"""Snapshots beside a stage's work: never two at a time into one file."""

import threading
from pathlib import Path

import pytest

from spot3d.dataflow import snapshot_writer
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.snapshot_file import write_snapshot
from spot3d.dataflow.snapshot_writer import SnapshotWriter, snapshot_path

LIMIT_S = 20.0


def test_a_snapshot_that_takes_long_is_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go, written, failures = threading.Event(), threading.Event(), list[list[bytes]](), list[str]()

    def write_slowly(_path: Path, pieces: list[bytes]) -> None:
        begun.set()
        assert go.wait(LIMIT_S)
        written.append(pieces)

    monkeypatch.setattr(snapshot_writer, "write_snapshot", write_slowly)
    monkeypatch.setattr("spot3d.dataflow.stopping._THREADS_END_S", 0.05)
    writer = SnapshotWriter(tmp_path / "fusion.snapshot", 1.0, failures.append)
    writer.write([b"first"])
    assert begun.wait(LIMIT_S)
    writer.write([b"second"])
    writer.write([b"third"], last=True)
    assert len(failures) == 2
    assert "still being written" in failures[0]
    go.set()
    writer._thread.join(LIMIT_S)
    assert written == [[b"first"]]
    writer.write([b"fourth"], last=True)
    assert written == [[b"first"], [b"fourth"]]


def test_a_snapshot_that_is_forgotten_while_it_is_written_does_not_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go, path = threading.Event(), threading.Event(), tmp_path / "fusion.snapshot"

    def write_slowly(path: Path, pieces: list[bytes]) -> None:
        begun.set()
        assert go.wait(LIMIT_S)
        write_snapshot(path, pieces)

    writer = SnapshotWriter(path, 1.0, pytest.fail)
    writer.forget()
    writer.write([b"first"], last=True)
    assert path.exists()
    monkeypatch.setattr(snapshot_writer, "write_snapshot", write_slowly)
    writer.write([b"second"])
    assert begun.wait(LIMIT_S)
    writer.forget()
    assert not path.exists()
    go.set()
    writer._thread.join(LIMIT_S)
    assert not path.exists()
    writer.write([b"third"], last=True)
    assert path.exists()


def test_each_robot_has_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    chosen = LinkSettings(robot="drone", snapshot_folder=str(tmp_path / "kept"))
    assert snapshot_path(chosen, "pose") == tmp_path / "kept" / "drone" / "pose.snapshot"
    assert (
        snapshot_path(LinkSettings(robot="drone"), "pose") == tmp_path / "state" / "spot3d" / "drone" / "pose.snapshot"
    )
    assert snapshot_path(chosen.model_copy(update={"robot": "other"}), "pose") != snapshot_path(chosen, "pose")
