"""The process that the stages of a run are forked from: what they all import is imported once, not six times.

    python -m spot3d.run.fork_server NEWS

Standard input takes one JSON object a line, {"start": stage, "arguments": [...], "log": file}, {"end": stage} or
{"kill": stage}. File descriptor NEWS gives one a line, {"stage": name, "pid": process id} when a stage has started and
{"stage": name, "code": exit code} when it has ended; on standard output a library may print when it is imported. When
standard input closes, all stages are ended.
"""

import gc
import importlib
import json
import os
import runpy
import select
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

_IMPORTED = (
    "cv2",
    "kiss_icp.config",
    "spot3d.source.selected",
    "spot3d.source.process",
    "spot3d.sensor",
    "spot3d.cli.app",
)
"""Modules that several stages need: libraries and, with a first small kernel, all that numba loads to load kernels.

Not the stages: their own kernels may have to be compiled, which they do in parallel.
"""
_LOOK_S = 0.05
"""Interval at which ended stages are looked for."""
_TERMINATE_S = 3.0
"""Time to end cleanly before a process is killed."""


class _ForkServer:
    """The stages' processes; the standard input of each is a pipe that closes when this process ends in any way."""

    def __init__(self, told: int) -> None:
        self._told = told
        self._stages: dict[int, str] = {}
        self._lifelines: dict[int, int] = {}

    def serve(self) -> None:
        """Follow the orders until their pipe closes, then end every stage."""
        orders = b""
        while True:
            if select.select([0], [], [], _LOOK_S)[0]:
                read = os.read(0, 65536)
                if not read:
                    break
                *lines, orders = (orders + read).split(b"\n")
                for line in lines:
                    self._obey(json.loads(line))
            self._reap()
        self._signal(signal.SIGTERM)
        deadline_s = time.monotonic() + _TERMINATE_S
        while self._stages and time.monotonic() < deadline_s:
            time.sleep(_LOOK_S)
            self._reap()
        self._signal(signal.SIGKILL)

    def _obey(self, order: dict[str, Any]) -> None:
        if "start" in order:
            self._fork(order["start"], order["arguments"], Path(order["log"]))
        elif "kill" in order:
            self._signal(signal.SIGKILL, order["kill"])
        else:
            self._signal(signal.SIGTERM, order["end"])

    def _fork(self, stage: str, arguments: list[str], log: Path) -> None:
        reading, writing = os.pipe()
        pid = os.fork()
        if pid == 0:
            for other in (*self._lifelines.values(), writing, self._told):
                os.close(other)
            _become(stage, arguments, reading, log)
        os.close(reading)
        self._stages[pid], self._lifelines[pid] = stage, writing
        self._tell({"stage": stage, "pid": pid})

    def _reap(self) -> None:
        """Report the stages that have ended."""
        while self._stages:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            os.close(self._lifelines.pop(pid))
            self._tell({"stage": self._stages.pop(pid), "code": os.waitstatus_to_exitcode(status)})

    def _tell(self, news: dict[str, str | int]) -> None:
        with suppress(BrokenPipeError):  # the supervisor is gone
            os.write(self._told, json.dumps(news).encode() + b"\n")

    def _signal(self, number: signal.Signals, stage: str | None = None) -> None:
        """Send a signal to one stage, or all; an ended stage stays a process until it is reaped."""
        for pid, name in self._stages.items():
            if stage in (None, name):
                os.kill(pid, number)


def _become(stage: str, arguments: list[str], standard_input: int, log: Path) -> NoReturn:
    """Continue as the process of a stage, like `spot3d STAGE ARGUMENTS`; its output goes to the log."""
    said = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for old, new in ((standard_input, 0), (said, 1), (said, 2)):
        os.dup2(old, new)
    os.close(standard_input)
    os.close(said)
    with suppress(OSError):  # without such a file all stages have one name
        Path("/proc/self/comm").write_text(f"spot3d {stage}", encoding="ascii")
    sys.argv = ["spot3d", stage, *arguments]
    runpy.run_module("spot3d", run_name="__main__")
    sys.exit(0)


if __name__ == "__main__":
    for name in _IMPORTED:
        with suppress(ImportError):  # the stage itself reports what it lacks
            importlib.import_module(name)
    # The garbage collector never writes to frozen objects, which thus stay shared between the stages.
    gc.freeze()
    _ForkServer(int(sys.argv[1])).serve()
