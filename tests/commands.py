"""Commands as a user starts them: one that runs to its end, and a router that others meet at."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from spot3d.settings import without_settings

LIMIT_S = 300.0
"""A first start may compile kernels."""


def spot3d(*arguments: str, before: tuple[str, ...] = (), **more: str) -> "subprocess.CompletedProcess[str]":
    """Run a command to its end; before: the command that starts it; more: of its environment, else without settings."""
    command = [*before, sys.executable, "-m", "spot3d", *arguments]
    environment = without_settings(os.environ) | more
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False, env=environment)


@contextmanager
def router_process(*arguments: str, listen: str) -> Iterator["subprocess.Popen[str]"]:
    """A router, once it has said that it listens there; killed at last."""
    command = [sys.executable, "-m", "spot3d", "router", *arguments, "--listen", listen]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert listen in process.stdout.readline()
            yield process
        finally:
            process.kill()
