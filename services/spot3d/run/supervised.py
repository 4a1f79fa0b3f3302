"""A stage that was started by a run ends with it, however the run ends."""

import os
import sys
import threading

_GRACE_S = 3.0


def stop_with_parent(stop: threading.Event) -> None:
    """Set `stop` when standard input, the supervisor's pipe, closes; the process ends by force three seconds later."""
    threading.Thread(target=_wait_for_end, args=(stop,), name="supervised", daemon=True).start()


def _wait_for_end(stop: threading.Event) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.set()
    threading.Event().wait(_GRACE_S)
    os._exit(1)
