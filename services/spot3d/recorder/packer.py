"""The recorder's handle of the process that compresses and writes."""

import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import msgpack

from spot3d.dataflow.process_use import KEEPING_MEMORY, raise_session_priority
from spot3d.recorder.backlog import Backlog, Heard
from spot3d.recorder.mcap_writer import ChannelSpec
from spot3d_schemas import STAGES

PATIENCE_S = 30.0
"""A process that is waited for and does nothing for this long hangs, as its disk does not answer. One that writes only
half a megabyte per second writes a chunk of 16 MB in this time."""
_LOOK_S = 0.1
_KILLED_S = 1.0
"""Time to end for a killed process. While the system waits for its disk it does not end, and is not waited for."""

_STAGES = (b"\0spot3d.run.fork_server\0", *(b"spot3d\0%s\0" % stage.encode() for stage in STAGES))
"""Substrings of the stages' command lines: of a run's, and of those that are started one by one."""


class Packer:
    """A process that writes the backlog to an MCAP file. In a live run it uses only idle processor time.

    kept, size, start_ns, end_ns: messages by channel, bytes, and log times of the first and the last message in the
    file. error: why it stopped writing, or empty.
    """

    def __init__(self, path: Path, backlog: Backlog, delivery: str) -> None:
        """Create a new file. Raises OSError if that fails, FileExistsError rather than overwrite one."""
        self.kept: Counter[int] = Counter()
        self.size = self.start_ns = self.end_ns = 0
        self.error = ""
        self._backlog = backlog
        self._channels = 0
        self._answered_s = time.monotonic()
        self._killed = False
        self._wire, theirs = Pipe()
        descriptors = theirs.fileno(), backlog.file
        command = [sys.executable, "-m", "spot3d.recorder.packing", *map(str, descriptors), str(path), delivery]
        # In the stages' session, an idle-priority process yields to them at once. In another session it would take that
        # session's share of the processors, so it gets one of its own, of the lowest priority. Ctrl-C is for the
        # recorder alone.
        apart = delivery == "live" and not _stages_in_this_session()
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            pass_fds=descriptors,
            env=os.environ | KEEPING_MEMORY,
            start_new_session=apart,
            process_group=None if apart else 0,
        )
        theirs.close()
        os.close(backlog.file)
        if not self._wait_for(self._wire.poll):
            raise OSError(self.error)
        try:
            what, *why = self._heard()
        except (EOFError, OSError) as error:
            raise OSError(self._how_it_died()) from error
        if what == "refused":
            self._process.wait()
            raise OSError(*why, str(path))
        self._listener = threading.Thread(target=self._listen, name="packer", daemon=True)
        self._listener.start()

    def ready(self, timeout_s: float = 0.0) -> bool:
        """Whether it takes an order now or within this time. Until then, an order waits (see `PATIENCE_S`)."""
        return bool(select.select((), (self._wire,), (), timeout_s)[1])

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        self._order("metadata", name, values)

    def channel(self, spec: ChannelSpec) -> int:
        """Announce a channel. Returns its id."""
        self._order("channel", *spec)
        self._channels += 1
        return self._channels

    def add(self, channel: int, item: Heard) -> None:
        """Add a message of the backlog. Its bytes are released when they are compressed."""
        self._order("add", channel, item.log_ns, item.publish_ns, item.sequence, item.at, item.size, item.place)

    def hurry(self) -> None:
        """Raise the process's priority, because somebody waits for it now."""
        with suppress(ProcessLookupError):
            raise_session_priority(self._process.pid)

    def finish(self, frames: str, skipped: dict[str, str]) -> None:
        """Wait until everything is in the file, or nothing more can be written. frames: the topic of the frames."""
        self._order("finish", frames, skipped)
        self._wait_for(self._has_ended)
        if self._has_ended(_LOOK_S):
            self._wire.close()

    def _order(self, *words: object) -> None:
        if self._wait_for(self.ready):
            with suppress(ConnectionError):  # it has ended, and the listener knows why
                self._wire.send_bytes(msgpack.packb(words))

    def _has_ended(self, timeout_s: float) -> bool:
        self._listener.join(timeout_s)
        return not self._listener.is_alive()

    def _wait_for(self, done: Callable[[float], bool]) -> bool:
        """Wait until `done`, which waits for some seconds itself, returns true.

        If the process hangs meanwhile it is killed, and false is returned, now and from then on.
        """
        since_s = time.monotonic()
        while not (self._killed or done(_LOOK_S)):
            if time.monotonic() - max(since_s, self._answered_s) > PATIENCE_S:
                self._killed = True
                hung = f"the process that writes it hung for {PATIENCE_S:g} s, and was killed"
                self.error = self.error or f"{hung}; see whether its disk answers"
                self._process.kill()
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(_KILLED_S)
        return not self._killed

    def _heard(self) -> tuple[Any, ...]:
        return tuple(msgpack.unpackb(self._wire.recv_bytes(), strict_map_key=False))

    def _listen(self) -> None:
        """Handle the process's answers until it has ended."""
        try:
            while True:
                answer = self._heard()
                self._answered_s = time.monotonic()
                match answer:
                    case ("done",):
                        self._backlog.done()
                    case ("written", kept, size, start_ns, end_ns):
                        self.kept, self.size, self.start_ns, self.end_ns = Counter(kept), size, start_ns, end_ns
                    case ("failed", why):
                        self._backlog.close()  # wakes threads that wait for room
                        self.error = self.error or str(why)
                    case _:
                        break
            self._process.wait()
        except (EOFError, OSError):
            self._backlog.close()
            self.error = self.error or self._how_it_died()

    def _how_it_died(self) -> str:
        code = self._process.wait()
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"the process that writes it has ended ({how})"


def _stages_in_this_session() -> bool:
    """Whether stages run in this process's session. False where the system does not say.

    Linux makes each session one group that shares the processors (autogroup).
    """
    mine = os.getsid(0)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # the process has ended meanwhile
            line = (folder / "cmdline").read_bytes()
            if any(stage in line for stage in _STAGES) and os.getsid(int(folder.name)) == mine:
                return True
    return False
