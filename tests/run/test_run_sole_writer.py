"""Two runs never write into one folder."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from spot3d.run.sole_writer import sole_writer
from spot3d.source.errors import SourceError

_HOLD = "import sys, pathlib\nfrom spot3d.run.sole_writer import sole_writer\n" + (
    "with sole_writer(pathlib.Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()\n"
)


def test_a_second_run_is_refused_until_the_first_has_ended(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "out"
    with sole_writer(folder):
        with pytest.raises(SourceError, match=r"another run writes into .*out; choose another folder"):
            sole_writer(folder).__enter__()
        with sole_writer(tmp_path / "other"):
            pass
    with sole_writer(folder):
        assert not list(folder.iterdir())


def test_a_killed_run_keeps_nobody_out(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(SourceError, match="another run"), sole_writer(tmp_path):
            pass
        holder.send_signal(signal.SIGKILL)
        holder.wait(timeout=10)
    with sole_writer(tmp_path):
        pass
