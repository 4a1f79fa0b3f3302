"""docker compose as the tests of the containers use it: the real thing, with a project of its own."""

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
HERE = ROOT / "out" / "containers"
"""In the checkout, which is all that an engine of with_engine.sh sees; no part of the repository."""


def compose(*arguments: str, limit_s: float = 300, **settings: str) -> str:
    """What `docker compose ARGUMENTS` prints, with these variables set; AssertionError with its words if it fails."""
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "DOCKER_HOST") if name in os.environ}
    run = subprocess.run(
        ["docker", "compose", "--project-name", "spot3d-test", "--progress", "plain", *arguments],
        cwd=ROOT,
        env=kept | settings,
        capture_output=True,
        text=True,
        timeout=limit_s,
    )
    assert run.returncode == 0, f"docker compose {' '.join(arguments)}: {run.stdout}{run.stderr}"
    return run.stdout


def inspect(service: str, template: str) -> str:
    """What docker knows of a service's container."""
    container = compose("ps", "--all", "--quiet", service).strip()
    command = ["docker", "inspect", "--format", template, container]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def inside(service: str, *command: str) -> str:
    """What a command in the service's container prints."""
    return compose("exec", "-T", service, *command)


def wait(until: Callable[[], bool], limit_s: float = 180) -> float:
    """Wait until something is so; returns the seconds that it took."""
    start_s = time.monotonic()
    while not until():
        assert time.monotonic() - start_s < limit_s, compose("logs", "--no-color", "--tail", "30")
        time.sleep(0.5)
    return time.monotonic() - start_s


def streams() -> list[dict[str, Any]]:
    """What the service `results` tells of the streams so far, in their order; `folder`: a copy of the files."""
    shutil.rmtree(HERE / "results", ignore_errors=True)
    compose("cp", "results:/results", str(HERE / "results"))
    told = sorted((HERE / "results").glob("*/stream.json"))
    return [json.loads(path.read_text()) | {"folder": path.parent} for path in told]
