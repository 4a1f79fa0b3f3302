"""How tests wait for what other threads and processes do."""

import time
from collections.abc import Callable


def wait_until(condition: Callable[[], bool], what: str = "it has come about", limit_s: float = 60.0) -> None:
    """Look some fifty times a second. Raises AssertionError, saying what is not so, after `limit_s`."""
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {limit_s:.0f} s: {what}"
        time.sleep(0.02)
