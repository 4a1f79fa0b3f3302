"""What an export leaves out, and what it refuses."""

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest
from recordings import ROBOT, damage_second_chunk, write_recording

from spot3d.recorder.foxglove_export import export
from spot3d.recorder.mcap_writer import McapWriter
from spot3d.run.results import RunResult, write_results
from spot3d.source.errors import SourceError
from spot3d_schemas import Header, Pose


def test_all_but_a_damaged_chunk_is_exported(recording: Path, tmp_path: Path) -> None:
    damage_second_chunk(recording)
    complaints = list[str]()
    written = export(recording, tmp_path / "out.mcap", complaints.append)
    assert written["/camera/image"] == 4
    assert len(complaints) == 1


def test_an_unfinished_recording_says_what_is_lost(recording: Path, tmp_path: Path) -> None:
    whole, complaints = recording.read_bytes(), list[str]()
    recording.write_bytes(whole[: len(whole) // 2])
    assert export(recording, tmp_path / "out.mcap", complaints.append)["/camera/image"] == 2
    (said,) = complaints
    assert "is incomplete" in said


def test_a_recording_that_shows_nothing_is_refused(tmp_path: Path) -> None:
    path, out = tmp_path / "lost.mcap", tmp_path / "out.mcap"
    header = Header(robot=ROBOT, seq=0, stamp_ns=1, frame_id="camera")
    lost = Pose(header=header, T_world_camera=np.eye(4), status="lost", reason="dark", provider="kiss")
    write_recording(path, [[("pose/pose", 0.0, lost)]])
    with pytest.raises(SourceError, match=r"lost\.mcap has nothing to export"):
        export(path, out, lambda text: None)
    assert not out.exists()


def test_a_run_of_nothing_is_refused(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "out.mcap"
    run.mkdir()
    write_results(run, RunResult())
    (run / "trajectory.txt").touch()
    (run / "report.json").write_text(json.dumps({"selection": {"name": "/nowhere"}}))
    (run / "settings.toml").touch()
    with pytest.raises(SourceError, match="run has nothing to export"):
        export(run, out, lambda text: None)
    assert not out.exists()


def test_an_export_onto_a_full_disk_leaves_nothing(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    finish, asked = McapWriter._finish, list[McapWriter]()

    def full(writer: McapWriter) -> None:
        asked.append(writer)
        if len(asked) == 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finish(writer)

    monkeypatch.setattr(McapWriter, "_finish", full)
    out = recording.with_name("out.mcap")
    with pytest.raises(OSError, match="No space"):
        export(recording, out, lambda text: None)
    assert not out.exists()
