"""Starts the stages' processes, restarts those that die, and leaves none behind."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Self

from spot3d.dataflow.process_use import KEEPING_MEMORY, SINGLE_THREADED
from spot3d.settings import without_settings

RESTARTS_MAX, RESTARTS_S = 5, 600.0
"""A stage that dies more often than this within so many seconds is given up."""
USER_ERROR = 2
"""Exit code of a stage whose error the user has to correct: starting it again would change nothing."""
_END_S = 5.0
"""Time for the fork server to end itself and all stages, by force if need be, before it is killed."""

_POINTER = "For further information visit https://errors.pydantic.dev"
"""Beginning of the last line of pydantic's errors, which does not say what is wrong."""

_ENVIRONMENT = {"PYTHONUNBUFFERED": "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
"""Searching for pydantic's plugins, of which there are none, takes a tenth of the time of all imports."""


@dataclass(slots=True)
class Child:
    """One stage's process. pid: None until it runs, and once it is killed or has ended. code: its exit code, or None.

    restarts: their number. recent_s: times of the latest ones, seconds. finished: it has ended, or was asked to, and is
    not started again.
    """

    stage: str
    arguments: list[str]
    log: Path
    pid: int | None = None
    code: int | None = None
    restarts: int = 0
    recent_s: deque[float] = field(default_factory=deque)
    finished: bool = False


@dataclass(frozen=True, slots=True)
class Death:
    """A stage's process has ended by itself. message: what to tell people; fatal: the run cannot go on."""

    stage: str
    message: str
    fatal: bool


class Supervisor:
    """Runs `spot3d STAGE ARGUMENTS` for each stage; use it in a `with` block, which ends all.

    The stages are forked from the fork server, which imports what they need as soon as the block is entered. clock: the
    time by which restarts are counted, seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.children: dict[str, Child] = {}
        self._clock = clock

    def __enter__(self) -> Self:
        environment = without_settings(os.environ) | SINGLE_THREADED | KEEPING_MEMORY | _ENVIRONMENT
        reading, writing = os.pipe()
        self._news = os.fdopen(reading, "rb")
        self._fork_server = subprocess.Popen(
            [sys.executable, "-m", "spot3d.run.fork_server", str(writing)],
            stdin=subprocess.PIPE,
            stdout=sys.__stderr__,
            pass_fds=(writing,),
            env=environment,
            # Its own group: Ctrl-C in a terminal reaches the supervisor alone, which then ends the stages in order.
            process_group=0,
        )
        os.close(writing)
        self._listener = threading.Thread(target=self._listen, args=(self._news,), name="fork server", daemon=True)
        self._listener.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self.stop()

    def start(self, stage: str, arguments: Sequence[str], log: Path) -> None:
        """Start one stage; its output goes to the file `log`."""
        log.unlink(missing_ok=True)
        self.children[stage] = Child(stage, list(arguments), log)
        self._launch(self.children[stage])

    def restarts(self) -> dict[str, int]:
        """How often each stage was restarted."""
        return {stage: child.restarts for stage, child in self.children.items()}

    def processes(self) -> dict[str, int]:
        """Process id of each stage that runs, and is neither killed nor asked to end."""
        running = {stage: child.pid for stage, child in self.children.items() if not child.finished}
        return {stage: pid for stage, pid in running.items() if pid is not None}

    def poll(self, restart_arguments: Mapping[str, Callable[[], Sequence[str]]]) -> list[Death]:
        """Find stages that have died and restart them; call it several times a second.

        restart_arguments: give a stage's new arguments; others keep theirs.
        """
        code = self._fork_server.poll()
        if code is not None:
            return [Death("fork server", f"the process that starts the stages {_how(code)}", fatal=True)]
        return [
            death
            for child in self.children.values()
            if not child.finished and (death := self._revive(child, restart_arguments.get(child.stage)))
        ]

    def end(self, stage: str) -> None:
        """Ask one stage to end and do not start it again."""
        self.children[stage].finished = True
        self._order({"end": stage})

    def kill(self, stage: str) -> None:
        """Kill one stage, which hangs; `poll` finds it dead."""
        self.children[stage].pid = None
        self._order({"kill": stage})

    def stop(self) -> None:
        """End every process: first by asking, after three seconds by force."""
        for child in self.children.values():
            child.finished = True
        if self._fork_server.stdin is not None:
            with suppress(OSError):  # it may be gone
                self._fork_server.stdin.close()
        if not self.children:
            self._fork_server.terminate()
        try:
            self._fork_server.wait(_END_S)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):  # it may have ended just now
                os.killpg(self._fork_server.pid, signal.SIGKILL)
            self._fork_server.wait()
        self._listener.join(_END_S)
        self._news.close()

    def _launch(self, child: Child) -> None:
        child.pid = child.code = None
        self._order({"start": child.stage, "arguments": child.arguments, "log": str(child.log.absolute())})

    def _order(self, order: Mapping[str, object]) -> None:
        pipe = self._fork_server.stdin
        if pipe is not None and not pipe.closed:
            with suppress(BrokenPipeError):  # `poll` reports a fork server that is gone
                pipe.write(json.dumps(order).encode() + b"\n")
                pipe.flush()

    def _listen(self, told: IO[bytes]) -> None:
        for line in told:
            news = json.loads(line)
            child = self.children[news["stage"]]
            child.pid, child.code = news.get("pid"), news.get("code")

    def _revive(self, child: Child, arguments: Callable[[], Sequence[str]] | None) -> Death | None:
        """Restart the child if it has died; returns what happened, None if nothing did."""
        code = child.code
        if code is None:
            return None
        if code == 0 and child.stage == "source":
            child.finished = True
            return None
        how = _how(code) if code < 0 else f"{_how(code)} ({last_line(child.log)})"
        if code == USER_ERROR:
            child.finished = True
            return Death(child.stage, f"{child.stage}: {last_line(child.log)}", fatal=True)
        now_s, recent_s = self._clock(), child.recent_s
        while recent_s and now_s - recent_s[0] >= RESTARTS_S:
            recent_s.popleft()
        often = f"in {RESTARTS_S / 60:.0f} minutes"
        if len(recent_s) == RESTARTS_MAX:
            child.finished = True
            message = f"{child.stage} {how} and was restarted {RESTARTS_MAX} times {often}; giving up, see {child.log}"
            return Death(child.stage, message, fatal=True)
        recent_s.append(now_s)
        child.restarts += 1
        child.arguments = child.arguments if arguments is None else list(arguments())
        self._launch(child)
        text = f"{child.stage} {how}; restarted ({len(recent_s)} of {RESTARTS_MAX} {often})"
        return Death(child.stage, text, fatal=False)


def last_line(log: Path) -> str:
    """The last line of a stage's log, without the prefix of an error message."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    lines = [line for line in map(str.strip, text.splitlines()) if line and not line.startswith(_POINTER)]
    return lines[-1].removeprefix("error: ") if lines else f"no message, see {log}"


def _how(code: int) -> str:
    return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
