"""The first moments of the command, in which it is imported."""

import signal
import subprocess
import sys
from importlib.metadata import entry_points

import pytest

STARTED = """
import os, signal, sys
from importlib.abc import MetaPathFinder

class CtrlC(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "spot3d.cli.app":
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, getattr(signal, sys.argv.pop()))
sys.meta_path.insert(0, CtrlC())
sys.argv[1:] = ["schema", "Frame"]
from spot3d.__main__ import main
main()
"""


@pytest.mark.parametrize(("handler", "code"), [("default_int_handler", 130), ("SIG_IGN", 0)])
def test_ctrl_c_during_the_import_ends_it_without_a_word_unless_it_is_ignored(handler: str, code: int) -> None:
    assert hasattr(signal, handler)
    done = subprocess.run(
        [sys.executable, "-c", STARTED, handler], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (code, "")
    assert bool(done.stdout) == (code == 0)


def test_the_command_starts_there() -> None:
    (command,) = entry_points(group="console_scripts", name="spot3d")
    assert command.value == "spot3d.__main__:main"
