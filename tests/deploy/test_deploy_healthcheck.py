"""The containers' health check: healthy while the process beats; one that hangs is killed."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "deploy" / "healthcheck.sh"


def check(heartbeat: Path) -> int:
    environment = os.environ | {"SPOT3D_LINK__HEARTBEAT": str(heartbeat)}
    return subprocess.run(["sh", str(SCRIPT)], env=environment, capture_output=True, timeout=30).returncode


@pytest.mark.parametrize(("age_s", "expected", "lives"), [(None, 1, True), (1, 0, True), (12, 1, True), (25, 1, False)])
def test_a_process_is_healthy_while_it_beats(tmp_path: Path, age_s: int | None, expected: int, lives: bool) -> None:
    heartbeat = tmp_path / "heartbeat"
    with subprocess.Popen(["sleep", "60"]) as process:
        if age_s is not None:
            heartbeat.write_text(f"{int(time.clock_gettime(time.CLOCK_BOOTTIME)) - age_s} {process.pid}\n")
        assert check(heartbeat) == expected
        if lives:
            assert process.poll() is None
            process.kill()
        assert process.wait(30) == -signal.SIGKILL
