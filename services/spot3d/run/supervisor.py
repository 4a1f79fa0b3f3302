"""Starts the stages' processes, restarts those that die, and leaves none behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from spot3d.dataflow.process_use import SINGLE_THREADED
from spot3d.settings import without_settings

RESTARTS_MAX = 5
"""A stage that dies more often than this is given up."""
USER_ERROR = 2
"""Exit code of a stage that cannot work as it was told to: starting it again would change nothing."""
_TERMINATE_S = 3.0
"""Time to end cleanly before a process is killed."""


@dataclass(slots=True)
class Child:
    """One stage's process. Its standard input is a pipe that closes when this process ends, however it ends."""

    stage: str
    arguments: list[str]
    log: Path
    process: subprocess.Popen[bytes] | None = None
    restarts: int = 0
    finished: bool = False


@dataclass(frozen=True, slots=True)
class Death:
    """A stage's process has ended by itself. message: what to tell people; fatal: the run cannot go on."""

    stage: str
    message: str
    fatal: bool


@dataclass(slots=True)
class Supervisor:
    """Runs `python -m spot3d STAGE ARGUMENTS` for each stage; use it in a `with` block, which ends all."""

    logs: Path
    children: dict[str, Child] = field(default_factory=dict)

    def __enter__(self) -> "Supervisor":
        return self

    def __exit__(self, *_error: object) -> None:
        self.stop()

    def start(self, stage: str, arguments: Sequence[str]) -> None:
        """Start one stage; what it says goes to `<logs>/<stage>.log`."""
        child = Child(stage, list(arguments), self.logs / f"{stage}.log")
        child.log.unlink(missing_ok=True)
        self.children[stage] = child
        _launch(child)

    def finished(self, stage: str) -> bool:
        """Whether the stage has ended of itself without an error."""
        return self.children[stage].finished

    def restarts(self) -> dict[str, int]:
        """How often each stage was started again."""
        return {stage: child.restarts for stage, child in self.children.items()}

    def poll(self, restart_arguments: Mapping[str, Sequence[str]]) -> list[Death]:
        """Notice the dead and start them again, with other arguments where given; call it several times a second."""
        return [
            death
            for child in self.children.values()
            if not child.finished and (death := _revive(child, restart_arguments.get(child.stage)))
        ]

    def end(self, stage: str) -> None:
        """Ask one stage to end and do not start it again."""
        child = self.children[stage]
        child.finished = True
        if child.process is not None and child.process.poll() is None:
            child.process.terminate()

    def stop(self) -> None:
        """End every process: first by asking, after three seconds by force."""
        for stage in self.children:
            self.end(stage)
        deadline = time.monotonic() + _TERMINATE_S
        for child in self.children.values():
            if child.process is None:
                continue
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                _kill(child.process)
            _close(child.process.stdin)


def _launch(child: Child) -> None:
    environment = without_settings(os.environ) | SINGLE_THREADED | {"PYTHONUNBUFFERED": "1"}
    with child.log.open("ab") as log:
        child.process = subprocess.Popen(
            [sys.executable, "-m", "spot3d", child.stage, *child.arguments],
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
            env=environment,
            # Its own group: Ctrl-C in a terminal reaches the supervisor alone, which then ends the stages in order.
            process_group=0,
        )


def _revive(child: Child, arguments: Sequence[str] | None) -> Death | None:
    """Start the child again where it has died; says what happened, None where nothing did."""
    process = child.process
    code = None if process is None else process.poll()
    if process is None or code is None:
        return None
    _close(process.stdin)
    if code == 0 and child.stage == "source":
        child.finished = True
        return None
    how = (
        f"was killed by {signal.Signals(-code).name}"
        if code < 0
        else f"ended with exit code {code} ({last_line(child.log)})"
    )
    if code == USER_ERROR:
        child.finished = True
        return Death(child.stage, f"{child.stage}: {last_line(child.log)}", fatal=True)
    if child.restarts == RESTARTS_MAX:
        child.finished = True
        message = f"{child.stage} {how} and was started {RESTARTS_MAX} times before; giving up, see {child.log}"
        return Death(child.stage, message, fatal=True)
    child.restarts += 1
    child.arguments = child.arguments if arguments is None else list(arguments)
    _launch(child)
    return Death(child.stage, f"{child.stage} {how}; started again ({child.restarts} of {RESTARTS_MAX})", fatal=False)


def last_line(log: Path) -> str:
    """The last line that a stage said, without the prefix of an error message."""
    lines = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    return lines[-1].removeprefix("error: ") if lines else f"no message, see {log}"


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):  # it may have ended just now
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _close(pipe: IO[bytes] | None) -> None:
    if pipe is not None:
        pipe.close()
