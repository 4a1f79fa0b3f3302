"""The dashboard of a run, in a process of its own, which stays when the run has ended."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO

from rich.console import Console

from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.stopping import stop_on_signals

_END_S = 5.0
_MAP_RATE = "20"
"""MB/s: on one host there is no bandwidth to save, and the map should be complete when the run ends."""


class DashboardProcess:
    """A dashboard that shows `robot`, and prints its address as soon as there is one.

    settings: the run's settings file; log: the dashboard's log file; endpoint: where it looks for the run's router.
    """

    def __init__(self, robot: str, settings: Path | None, log: Path, console: Console) -> None:
        self.endpoint, self.log, self.console = free_loopback_endpoint(), log, console
        self._command = [sys.executable, "-m", "spot3d", "dashboard", "--robot", robot, "--connect", self.endpoint]
        self._command += ["--supervised", *(() if settings is None else ("--settings", str(settings)))]
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start it; the run's folder, for its log, is there."""
        environment = {"SPOT3D_DASHBOARD__MAP_RATE": _MAP_RATE} | os.environ | {"PYTHONUNBUFFERED": "1"}
        with self.log.open("w", encoding="utf-8") as log:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env=environment,
                text=True,
                # Ctrl-C in a terminal reaches the run alone, which then ends the dashboard.
                process_group=0,
            )
        if self._process.stdout is not None:
            threading.Thread(target=_echo, args=(self._process.stdout, self.console), daemon=True).start()

    def keep(self) -> None:
        """Wait until Ctrl-C, or until the dashboard has ended by itself."""
        if self._runs():
            self.console.print("the dashboard stays until Ctrl-C", highlight=False)
        with stop_on_signals(None) as stopped:
            while self._runs() and not stopped.wait(0.2):
                pass
            if not stopped.is_set():
                said = f"the dashboard has ended; see {self.log}"
                self.console.print(said, markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None:
        """End it, if it was started."""
        if self._process is None:
            return
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _runs(self) -> bool:
        return self._process is not None and self._process.poll() is None


def _echo(said: IO[str], console: Console) -> None:
    with said:
        for line in said:
            console.print(line.rstrip(), markup=False, highlight=False, soft_wrap=True)
