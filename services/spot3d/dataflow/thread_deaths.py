"""Ends a process when one of its threads dies, so that its supervisor restarts it."""

import os
import sys
import threading
import traceback

EXIT_CODE = 70
"""EX_SOFTWARE: an internal error."""


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
    os._exit(EXIT_CODE)
