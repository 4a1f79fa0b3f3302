"""A process one of whose threads has died ends, so that whoever supervises it starts it again."""

import os
import sys
import threading
import traceback

EXIT_CODE = 70
"""EX_SOFTWARE: something is wrong inside."""


def end_with_any_thread() -> None:
    """From now on an exception that ends a thread ends the process, and its last words say which and why.

    Half a stage looks alive, and whoever waits for the other half waits for ever. What else somebody has set up for
    such exceptions stays.
    """
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = _end


def _end(death: threading.ExceptHookArgs) -> None:
    if death.exc_type is SystemExit:
        return
    name = "one without a name" if death.thread is None else death.thread.name
    traceback.print_exception(death.exc_type, death.exc_value, death.exc_traceback)
    why = f"{death.exc_type.__name__}: {death.exc_value}"
    sys.stderr.write(f"error: the process ends: its thread {name!r} died of {why}\n")
    sys.stderr.flush()
    os._exit(EXIT_CODE)
