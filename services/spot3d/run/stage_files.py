"""What the stages of a distributed run need in its folder: logs, settings and snapshots."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from spot3d_schemas import STAGES

LOGS = "logs"
"""Folder of the stages' logs and of their settings."""
SETTINGS = "settings.toml"
SNAPSHOTS = "snapshots"
"""Folder of the snapshots that restarted stages resume from; deleted when the run ends, unless it is killed."""


def delete_logs(run: Path) -> None:
    """Delete the logs and settings that an earlier run's stages have left, and nothing else in their folder."""
    _delete(run / LOGS, (run / LOGS / name for name in (SETTINGS, *(f"{stage}.log" for stage in STAGES))))


def delete_snapshots(run: Path) -> None:
    """Delete the stages' snapshots, and nothing else in their folders."""
    for robot in (run / SNAPSHOTS).glob("*/"):
        _delete(robot, (*robot.glob("*.snapshot"), *robot.glob(".*.snapshot.*partial")))
    _delete(run / SNAPSHOTS, ())


def _delete(folder: Path, files: Iterable[Path]) -> None:
    """Delete files, and their folder if it is then empty, as far as this can be done."""
    with suppress(OSError):
        for file in files:
            file.unlink(missing_ok=True)
        folder.rmdir()
