"""Which stages a source waits for before its first frame."""

import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from spot3d.cli import app as cli
from spot3d.source import process, selected
from spot3d.source.process import EVERY_STAGE, FUSING_STAGES

RECORDING = b"#ROSBAG V2.0\n\x45\x00\x00\x00\x12\x00\x00\x00index_pos=" + (200).to_bytes(8, "little")
OF_THE_SDK = RECORDING.ljust(200, b"\0") + b"topic=/device_0/sensor_0/Depth_0/image/data"
WITHOUT_POSE = tuple(stage for stage in EVERY_STAGE if stage != "pose")


@pytest.mark.parametrize(
    ("arguments", "awaited"),
    [
        (["scene", "--lossless"], EVERY_STAGE),
        (["scene", "--live"], EVERY_STAGE),
        (["scene", "--live", "--no-pose-stage"], WITHOUT_POSE),
        (["scene", "--live", "--supervised"], EVERY_STAGE),
        (["{tmp}/walk.bag", "--live"], EVERY_STAGE),
        (["{tmp}/walk.bag", "--live", "--supervised"], EVERY_STAGE),
        (["realsense", "--live"], ()),
        (["realsense:123", "--live"], ()),
        (["realsense", "--live", "--supervised"], FUSING_STAGES),
        (["realsense:123", "--live", "--supervised"], FUSING_STAGES),
        (["realsense", "--lossless"], EVERY_STAGE),
    ],
)
def test_only_a_live_camera_waits_for_nobody(
    arguments: list[str], awaited: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "walk.bag").write_bytes(OF_THE_SDK)
    waited: list[tuple[str, ...]] = []
    monkeypatch.setattr(process, "run", lambda *_arguments, wait_for, **_named: waited.append(wait_for))
    monkeypatch.setattr(selected, "open_stream", lambda _name: None)
    monkeypatch.setattr("spot3d.cli.stages.stage_started", lambda _supervised: threading.Event())
    done = CliRunner().invoke(cli.app, ["source", *(text.format(tmp=tmp_path) for text in arguments)])
    assert done.exit_code == 0, done.output
    assert waited == [awaited]
