"""Who else runs in this process's session, of which Linux makes one group that shares the processors (autogroup)."""

import os
from contextlib import suppress
from pathlib import Path

from spot3d_schemas import STAGES

_STAGES = (b"\0spot3d.run.fork_server\0", *(b"spot3d\0%s\0" % stage.encode() for stage in STAGES))
"""In the command lines of stages: of those of a run, and of those that were started one by one."""


def stages_in_this_session() -> bool:
    """Whether stages run in this process's session; False where the system does not say."""
    mine = os.getsid(0)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended meanwhile
            line = (folder / "cmdline").read_bytes()
            if any(stage in line for stage in _STAGES) and os.getsid(int(folder.name)) == mine:
                return True
    return False
