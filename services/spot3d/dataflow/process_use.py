"""What this process uses, how it is kept to one thread, and with which priority it runs."""

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
"""Environment of a stage's process; libraries read it when they are loaded, so the parent has to set it."""

KEEPING_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(8 << 20), "MALLOC_TRIM_THRESHOLD_": str(64 << 20)}
"""Environment of a stage's process: memory for images is kept for the next frame (glibc's malloc; others ignore it).

Returning it and getting fresh pages takes a fifth of the source's time, and more where messages go by TCP.
"""


_NICENESS, _ONLOOKERS_NICENESS = 5, 19
"""Niceness of work that no frame waits for, and of onlookers. Where the processors are busy, the first gets what the
stages leave, and the second next to nothing."""


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
    """Keep libraries, loaded already or later, from starting threads of their own."""
    for name, value in SINGLE_THREADED.items():
        os.environ.setdefault(name, value)
    cv2 = sys.modules.get("cv2")
    if cv2 is not None:
        cv2.setNumThreads(1)
    if "numpy" in sys.modules:
        # Its BLAS has read its environment already, and two threads add up in another order than one.
        from threadpoolctl import threadpool_limits

        threadpool_limits(1)


def let_frames_go_first() -> None:
    """Lower the priority of the calling thread, for work that no frame waits for."""
    _stand_back(_NICENESS)


def let_stages_go_first() -> None:
    """Lower the priority of the calling thread, and of those it starts later, below every stage: for onlookers."""
    _stand_back(_ONLOOKERS_NICENESS)


def run_when_idle() -> None:
    """Let this process run only on processors that nobody else wants, for work that nobody ever waits for.

    Niceness is not enough: when a stage's frame comes, Linux lets a nice process finish its time slice of some
    milliseconds, but not one of the idle class. That holds within one session only, as each session has its share of
    the processors (autogroup): a session leader gives up its share as well.
    """
    if sys.platform == "linux":
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        if os.getsid(0) == os.getpid():
            with suppress(OSError):  # a kernel without autogroup
                Path("/proc/self/autogroup").write_text(str(_ONLOOKERS_NICENESS), encoding="ascii")


def raise_session_priority(pid: int) -> None:
    """Give the session of a process that called `run_when_idle` the priority of work that no frame waits for.

    On busy processors it then ends in seconds, not minutes: somebody waits for it.
    """
    if sys.platform == "linux" and os.getsid(pid) == pid:
        with suppress(OSError):
            Path(f"/proc/{pid}/autogroup").write_text(str(_NICENESS), encoding="ascii")


def _stand_back(niceness: int) -> None:
    if sys.platform == "linux":  # elsewhere one thread's priority cannot be set
        thread = threading.get_native_id()
        with suppress(OSError):  # a sandbox may forbid it: frames then wait a little
            os.setpriority(os.PRIO_PROCESS, thread, min(19, os.getpriority(os.PRIO_PROCESS, thread) + niceness))
