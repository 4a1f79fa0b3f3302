"""The recorder's side of the process that packs and writes."""

import os
import signal
import subprocess
import sys
import threading
from collections import Counter
from contextlib import suppress
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import msgpack

from spot3d.dataflow.process_use import KEEPING_MEMORY, let_it_finish
from spot3d.recorder.backlog import Backlog, Heard
from spot3d.recorder.mcap_writer import ChannelSpec
from spot3d_schemas import STAGES

_STAGES = (b"\0spot3d.run.fork_server\0", *(b"spot3d\0%s\0" % stage.encode() for stage in STAGES))
"""In the command lines of stages: of those of a run, and of those that were started one by one."""


class Packer:
    """A process that writes an MCAP file of what is in the backlog; where nobody may wait for it, by what is left.

    kept, size, start_ns, end_ns: messages by channel, bytes, and log times of the first and the last message that are
    in the file. error: why it takes no more, or empty.
    """

    def __init__(self, path: Path, backlog: Backlog, delivery: str) -> None:
        """Begin a new file. Raises OSError where that cannot be, FileExistsError rather than write over another."""
        self.kept: Counter[int] = Counter()
        self.size = self.start_ns = self.end_ns = 0
        self.error = ""
        self._backlog = backlog
        self._channels = 0
        self._wire, theirs = Pipe()
        descriptors = theirs.fileno(), backlog.file
        command = [sys.executable, "-m", "spot3d.recorder.packing", *map(str, descriptors), str(path), delivery]
        # Beside the stages, what is idle gets out of their way at once; in another session it had that one's share of
        # the processors, so it has one of its own, of the lowest priority. Ctrl-C is for the recorder alone.
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
        try:
            what, *why = self._heard()
        except (EOFError, OSError) as error:
            raise OSError(self._how_it_died()) from error
        if what == "refused":
            self._process.wait()
            raise OSError(*why, str(path))
        self._listener = threading.Thread(target=self._listen, name="packer", daemon=True)
        self._listener.start()

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        self._order("metadata", name, values)

    def channel(self, spec: ChannelSpec) -> int:
        """Announce a channel; returns its id."""
        self._order("channel", *spec)
        self._channels += 1
        return self._channels

    def add(self, channel: int, item: Heard) -> None:
        """Add a message of the backlog, whose bytes are given back when they are packed."""
        self._order("add", channel, item.log_ns, item.publish_ns, item.sequence, item.at, item.size, item.place)

    def hurry(self) -> None:
        """From now on somebody waits for it."""
        with suppress(ProcessLookupError):
            let_it_finish(self._process.pid)

    def finish(self, frames: str, skipped: dict[str, str]) -> None:
        """Wait until all of it is in the file, or until nothing more can be. frames: the topic of the frames."""
        self._order("finish", frames, skipped)
        self._listener.join()
        self._wire.close()

    def _order(self, *words: object) -> None:
        with suppress(ConnectionError):  # it has ended; the listener knows why
            self._wire.send_bytes(msgpack.packb(words))

    def _heard(self) -> tuple[Any, ...]:
        return tuple(msgpack.unpackb(self._wire.recv_bytes(), strict_map_key=False))

    def _listen(self) -> None:
        """Take the answers until the process has ended."""
        try:
            while True:
                match self._heard():
                    case ("done",):
                        self._backlog.done()
                    case ("written", kept, size, start_ns, end_ns):
                        self.kept, self.size, self.start_ns, self.end_ns = Counter(kept), size, start_ns, end_ns
                    case ("failed", why):
                        self._backlog.close()  # who waits for room is let go
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
        return f"the process that writes it has died ({how})"


def _stages_in_this_session() -> bool:
    """Whether stages run in this process's session, of which Linux makes one group that shares the processors
    (autogroup); False where the system does not say."""
    mine = os.getsid(0)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended meanwhile
            line = (folder / "cmdline").read_bytes()
            if any(stage in line for stage in _STAGES) and os.getsid(int(folder.name)) == mine:
                return True
    return False
