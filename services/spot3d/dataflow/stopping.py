"""Ends a stage's process at SIGINT, SIGTERM, SIGHUP or its stop event, with its run, and with any of its threads."""

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType

_THREADS_END_S = 2.0
_GRACE_S = 3.0
"""Time to end cleanly once the run is gone."""
_EXIT_CODE = 70
"""EX_SOFTWARE: an internal error."""


class StoppedError(Exception):
    """The process was asked to stop, or its patience ran out, before it had a session."""


@contextmanager
def stop_on_signals(stop: threading.Event | None) -> Iterator[threading.Event]:
    """The stop event: the given one or a new one, also set by SIGINT, SIGTERM and SIGHUP.

    SIGHUP, sent when a terminal closes, stays ignored if it was, as by nohup. Outside the main thread signals are left
    to their present handlers. A StoppedError ends the block silently.
    """
    event = stop or threading.Event()
    with suppress(StoppedError), _set_by_signals(event):
        yield event


@contextmanager
def _set_by_signals(event: threading.Event) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def set_event(_number: int, _frame: FrameType | None) -> None:
        event.set()

    heard = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        heard.append(signal.SIGHUP)
    before = {number: signal.signal(number, set_event) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def stop_with_parent(stop: threading.Event) -> None:
    """Set `stop` when standard input, the supervisor's pipe, closes; the process ends by force three seconds later."""
    threading.Thread(target=_wait_for_end, args=(stop,), name="supervised", daemon=True).start()


def _wait_for_end(stop: threading.Event) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.set()
    threading.Event().wait(_GRACE_S)
    os._exit(1)


def end_threads(threads: Sequence[threading.Thread]) -> None:
    """Wait for threads that have been told to end, two seconds in all at most.

    An interpreter that ends while a thread is in native code aborts the process.
    """
    end_s = time.monotonic() + _THREADS_END_S
    for thread in threads:
        if thread.ident is not None:
            thread.join(max(0.0, end_s - time.monotonic()))


def end_with_any_thread() -> None:
    """From now on an exception that ends a thread ends the process; standard error says which thread, and why.

    A stage that has lost a thread looks alive, and others would wait for it for ever. An excepthook that is set already
    stays.
    """
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = _end


def _end(death: threading.ExceptHookArgs) -> None:
    if death.exc_type is SystemExit:
        return
    name = "unnamed" if death.thread is None else death.thread.name
    traceback.print_exception(death.exc_type, death.exc_value, death.exc_traceback)
    why = f"{death.exc_type.__name__}: {death.exc_value}"
    sys.stderr.write(f"error: the process ends, as its thread {name!r} failed with {why}\n")
    sys.stderr.flush()
    os._exit(_EXIT_CODE)
