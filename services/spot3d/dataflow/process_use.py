"""What this process uses, and how it is kept to one thread."""

import os
import resource
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
"""Environment of a stage's process; libraries read it when they are loaded, so it is the parent's to set."""

KEEPING_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(8 << 20), "MALLOC_TRIM_THRESHOLD_": str(64 << 20)}
"""Environment of a stage's process: memory for images is kept for the next frame (glibc's malloc; others ignore it).

Giving it back and getting fresh pages takes a fifth of the source's time, and more where messages go by TCP.
"""


_NICENESS, _ONLOOKERS_NICENESS = 5, 19
"""How far work that no frame waits for stands back: where the processors are busy, it takes what the stages leave. Who
only looks on takes next to nothing there."""


@dataclass(frozen=True, slots=True)
class ProcessUse:
    """cpu_s: user and system time so far; rss_bytes: memory now (peak where the system does not say)."""

    cpu_s: float
    rss_bytes: int
    threads: int


def process_use() -> ProcessUse:
    """What this process uses now."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        threads = len(list(Path("/proc/self/task").iterdir()))
        return ProcessUse(time.process_time(), pages * os.sysconf("SC_PAGE_SIZE"), threads)
    except OSError:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return ProcessUse(
            time.process_time(), peak * (1 if sys.platform == "darwin" else 1024), threading.active_count()
        )


def stay_single_threaded() -> None:
    """Keep the libraries that are loaded already, and those to come, from starting threads of their own."""
    for name, value in SINGLE_THREADED.items():
        os.environ.setdefault(name, value)
    cv2 = sys.modules.get("cv2")
    if cv2 is not None:
        cv2.setNumThreads(1)
    if "numpy" in sys.modules:
        # Its BLAS has read its environment, and of two threads adds up in another order than one.
        from threadpoolctl import threadpool_limits

        threadpool_limits(1)


def let_frames_go_first() -> None:
    """Lower the priority of the calling thread below what it is, for work that no frame waits for."""
    _stand_back(_NICENESS)


def let_stages_go_first() -> None:
    """Lower the priority of the calling thread, and of those that it starts from now on, below everything a stage does:
    for who only looks on."""
    _stand_back(_ONLOOKERS_NICENESS)


def use_what_is_left() -> None:
    """Let this process run only where nobody else wants the processor: for work that nobody ever waits for.

    Not merely nice: Linux lets a nice process end its turn of some milliseconds when a stage's frame comes, and an idle
    one not. That holds within a session alone, each of which has a share of the processors (autogroup): who leads one
    gives up its share as well.
    """
    if sys.platform == "linux":
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        if os.getsid(0) == os.getpid():
            with suppress(OSError):  # a kernel without autogroup
                Path("/proc/self/autogroup").write_text(str(_ONLOOKERS_NICENESS), encoding="ascii")


def let_it_finish(pid: int) -> None:
    """Give the session of another process that used what was left the priority of work that no frame waits for.

    Where all processors are busy it is done in seconds then, not minutes: somebody waits for it.
    """
    if sys.platform == "linux" and os.getsid(pid) == pid:
        with suppress(OSError):
            Path(f"/proc/{pid}/autogroup").write_text(str(_NICENESS), encoding="ascii")


def _stand_back(niceness: int) -> None:
    if sys.platform == "linux":  # elsewhere the priority of a thread cannot be set alone
        thread = threading.get_native_id()
        with suppress(OSError):  # a sandbox may forbid it: the work is the same, the frames wait a little
            os.setpriority(os.PRIO_PROCESS, thread, min(19, os.getpriority(os.PRIO_PROCESS, thread) + niceness))
