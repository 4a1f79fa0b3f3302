"""The supervisor reports stages that end, and the end of the process that they are forked from."""

import os
import signal
import time
from pathlib import Path

from spot3d.run.supervisor import Death, Supervisor

LIMIT_S = 60.0


def first_death(supervisor: Supervisor) -> Death:
    end_s = time.monotonic() + LIMIT_S
    while time.monotonic() < end_s:
        if deaths := supervisor.poll({}):
            return deaths[0]
        time.sleep(0.02)
    raise TimeoutError("no stage has ended")


def test_what_a_user_can_put_right_is_told_in_one_line(tmp_path: Path) -> None:
    with Supervisor() as supervisor:
        supervisor.start("source", [str(tmp_path / "nothing")], tmp_path / "source.log")
        death = first_death(supervisor)
    assert death.fatal
    assert death.stage == "source"
    assert death.message.startswith(f"source: {tmp_path / 'nothing'} does not exist")


def test_a_run_cannot_go_on_without_the_process_that_starts_its_stages(tmp_path: Path) -> None:
    with Supervisor() as supervisor:
        supervisor.start("fusion", ["--connect", "tcp/127.0.0.1:9", "--supervised"], tmp_path / "fusion.log")
        end_s = time.monotonic() + LIMIT_S
        while not (tmp_path / "fusion.log").exists():
            assert time.monotonic() < end_s, "fusion has not started"
            assert not supervisor.poll({})
            time.sleep(0.02)
        os.kill(supervisor.fork_server_pid, signal.SIGKILL)
        death = first_death(supervisor)
    assert death.fatal
    assert "SIGKILL" in death.message
