"""The dashboard of a run, in a process of its own, which stays when the run has ended."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from rich.console import Console

from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.run.sole_writer import sole_writer

_END_S = 5.0
_MAP_RATE = "20"
"""MB/s: on one host there is no bandwidth to save, and the map should be complete when the run ends."""


@dataclass(frozen=True, slots=True)
class DashboardProcess:
    """A dashboard's process. endpoint: where it looks for the run's router; log: its log file."""

    endpoint: str
    process: subprocess.Popen[str]
    log: Path

    def keep(self, console: Console) -> None:
        """Wait until Ctrl-C, or until the dashboard has ended by itself."""
        if self.process.poll() is None:
            console.print("the dashboard stays until Ctrl-C", highlight=False)
        with stop_on_signals(None) as stopped:
            while self.process.poll() is None and not stopped.wait(0.2):
                pass
            if not stopped.is_set():
                console.print(f"the dashboard has ended; see {self.log}", markup=False, highlight=False, soft_wrap=True)


@contextmanager
def dashboard_of_run(robot: str, settings: Path | None, folder: Path, console: Console) -> Iterator[DashboardProcess]:
    """A dashboard that shows `robot`, and ends with the block; it prints its address as soon as there is one.

    settings: the run's settings file; folder: of the run's results, for the dashboard's log.
    """
    endpoint = free_loopback_endpoint()
    command = [sys.executable, "-m", "spot3d", "dashboard", "--robot", robot, "--connect", endpoint, "--supervised"]
    if settings is not None:
        command += ["--settings", str(settings)]
    environment = {"SPOT3D_DASHBOARD__MAP_RATE": _MAP_RATE} | os.environ | {"PYTHONUNBUFFERED": "1"}
    # Not into the folder of a run that is still going on.
    with sole_writer(folder), (folder / "dashboard.log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            env=environment,
            text=True,
            # Ctrl-C in a terminal reaches the run alone, which then ends the dashboard.
            process_group=0,
        )
    threading.Thread(target=_echo, args=(process.stdout, console), daemon=True).start()
    try:
        yield DashboardProcess(endpoint, process, folder / "dashboard.log")
    finally:
        if process.stdin is not None:
            process.stdin.close()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _echo(said: IO[str] | None, console: Console) -> None:
    for line in said or ():
        console.print(line.rstrip(), markup=False, highlight=False, soft_wrap=True)
