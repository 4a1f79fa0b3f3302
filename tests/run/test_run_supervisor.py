"""The supervisor reports stages that end, and the end of the process that they are forked from."""

import os
import signal
import time
import traceback
from pathlib import Path

import pytest
from pydantic import ValidationError

from spot3d.run.supervisor import RESTARTS_MAX, RESTARTS_S, Child, Death, Supervisor, last_line
from spot3d_schemas import CameraIntrinsics
from waiting import wait_until

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


def test_the_reason_of_a_death_is_what_was_wrong_not_where_to_read_on(tmp_path: Path) -> None:
    log = tmp_path / "source.log"
    with pytest.raises(ValidationError) as refused:
        CameraIntrinsics(fx=500.0, fy=500.0, cx=0.0, cy=0.0, width=4096, height=2048)
    log.write_text("".join(traceback.format_exception(refused.value)))
    assert "pydantic.dev" in log.read_text().splitlines()[-1]
    assert last_line(log).startswith("Value error, 4096x2048 exceeds the limit")


def test_a_run_cannot_go_on_without_the_process_that_starts_its_stages(tmp_path: Path) -> None:
    with Supervisor() as supervisor:
        supervisor.start("fusion", ["--connect", "tcp/127.0.0.1:9", "--supervised"], tmp_path / "fusion.log")
        end_s = time.monotonic() + LIMIT_S
        while not (tmp_path / "fusion.log").exists():
            assert time.monotonic() < end_s, "fusion has not started"
            assert not supervisor.poll({})
            time.sleep(0.02)
        os.kill(supervisor._fork_server.pid, signal.SIGKILL)
        death = first_death(supervisor)
    assert death.fatal
    assert "SIGKILL" in death.message


def test_a_stage_that_hangs_is_killed_and_started_again(tmp_path: Path) -> None:
    with Supervisor() as supervisor:
        supervisor.start("fusion", ["--connect", "tcp/127.0.0.1:9", "--supervised"], tmp_path / "fusion.log")
        wait_until(lambda: "fusion" in supervisor.processes(), "fusion runs", LIMIT_S)
        hanging = supervisor.processes()["fusion"]
        os.kill(hanging, signal.SIGSTOP)
        assert not supervisor.poll({})
        supervisor.kill("fusion")
        assert not supervisor.processes(), "it is not to be killed again"
        death = first_death(supervisor)
        assert death.message == "fusion was killed by SIGKILL; restarted (1 of 5 in 10 minutes)"
        wait_until(lambda: "fusion" in supervisor.processes(), "fusion runs again", LIMIT_S)
        assert supervisor.processes()["fusion"] != hanging


def test_only_restarts_of_the_last_minutes_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def die_at_once(_supervisor: Supervisor, child: Child) -> None:
        child.code = -signal.SIGSEGV

    monkeypatch.setattr(Supervisor, "_launch", die_at_once)
    now_s = 0.0
    with Supervisor(lambda: now_s) as supervisor:
        supervisor.start("fusion", [], tmp_path / "fusion.log")
        for _ in range(3 * RESTARTS_MAX):  # never more than five in ten minutes, for as long as it goes on
            (death,) = supervisor.poll({})
            assert not death.fatal
            now_s += RESTARTS_S / RESTARTS_MAX
        assert "restarted (5 of 5 in 10 minutes)" in death.message
        assert supervisor.restarts() == {"fusion": 3 * RESTARTS_MAX}
        now_s -= 1.0
        (death,) = supervisor.poll({})
    assert death.fatal
    assert "was restarted 5 times in 10 minutes; giving up" in death.message
