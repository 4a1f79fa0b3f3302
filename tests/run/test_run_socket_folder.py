"""The folder of the stages' socket goes with its run, however that ends."""

import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from spot3d.run.socket_folder import stages_socket

LIMIT_S = 20.0
_RUN = "import sys\nfrom spot3d.run.socket_folder import stages_socket\n" + (
    "with stages_socket() as socket:\n    socket.touch()\n    print(socket, flush=True)\n    sys.stdin.read()\n"
)


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)


@contextmanager
def other_run() -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Another run's process and socket; killed at last."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", _RUN], text=True, **pipes) as process:
        try:
            assert process.stdout is not None
            yield process, Path(process.stdout.readline().rstrip())
        finally:
            process.kill()
            process.wait(LIMIT_S)


def left_behind() -> Path:
    """The socket of a run that was killed."""
    with other_run() as (_, socket):
        pass
    return socket


def test_it_is_private_and_deleted_at_the_end(tmp_path: Path) -> None:
    with stages_socket() as socket:
        socket.touch()
        assert socket.parent.parent == tmp_path
        assert socket.parent.stat().st_mode & 0o777 == 0o700
    assert not list(tmp_path.iterdir())


def test_it_is_elsewhere_if_the_temporary_files_are_too_deep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = tmp_path / ("x" * 100)
    deep.mkdir()
    monkeypatch.setenv("TMPDIR", str(deep))
    with stages_socket() as path, socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        assert not list(deep.iterdir())
    assert not path.parent.exists()


def test_what_a_killed_run_left_is_deleted_by_the_next_one(tmp_path: Path) -> None:
    socket = left_behind()
    assert socket.exists()
    with stages_socket() as own:
        assert list(tmp_path.iterdir()) == [own.parent]


def test_that_of_a_run_that_goes_on_stays(tmp_path: Path) -> None:
    with other_run() as (process, socket):
        with stages_socket() as own:
            own.touch()
            assert socket.exists()
            with stages_socket():
                assert own.exists(), "also of one in the same process"
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(LIMIT_S) == 0
    assert not list(tmp_path.iterdir())


def test_what_may_be_somebody_else_s_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    socket = left_behind()
    made_just_now, mine, link = tmp_path / "spot3d-run-new", tmp_path / "mine", tmp_path / "spot3d-run-link"
    made_just_now.mkdir()
    mine.mkdir()
    (mine / "stages").touch()
    link.symlink_to(mine)
    with monkeypatch.context() as patched, stages_socket():
        assert not socket.exists()
        assert made_just_now.exists()
        assert (link / "stages").exists()
        patched.setattr(os, "geteuid", lambda: os.getuid() + 1)
        (made_just_now / "stages").touch()
        with stages_socket():
            assert made_just_now.exists(), "another user's"
