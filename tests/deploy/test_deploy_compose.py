"""docker-compose.yml: a locked-down container for each stage, with commands and settings that exist.

What it does when it runs is tested by `make test-containers`.
"""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from spot3d.settings import load_settings
from spot3d_schemas import STAGES

ROOT = Path(__file__).parents[2]
SERVICES: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
WRITABLE = {"/var/cache/spot3d", "/dev/shm", "/run/spot3d", "/var/lib/spot3d", "/results"}
"""Where volumes of our own are; everything else that is mounted is read-only."""


def resolved(text: str) -> str:
    """`text` as compose reads it with nothing set: ${NAME:-default} becomes the default."""
    return re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", text)


def test_one_container_for_each_stage_and_what_stands_around_them() -> None:
    assert set(SERVICES) == {*STAGES, "router", "results", "dashboard"}
    assert SERVICES["dashboard"]["profiles"] == ["dashboard"]
    assert [resolved(port) for port in SERVICES["dashboard"]["ports"]] == ["127.0.0.1:8080:8080"]


@pytest.mark.parametrize("name", SERVICES)
def test_container_is_locked_down_and_bounded(name: str) -> None:
    service = SERVICES[name]
    assert "privileged" not in service
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert {"cpus", "mem_limit", "pids_limit", "restart", "healthcheck"} <= set(service)
    assert service["logging"]["options"].keys() == {"max-size", "max-file"}
    for volume in service["volumes"]:
        assert volume["read_only"] if isinstance(volume, dict) else volume.split(":")[1] in WRITABLE


@pytest.mark.parametrize("name", SERVICES)
def test_container_runs_its_own_command_in_the_one_image(name: str) -> None:
    service = SERVICES[name]
    assert service["command"][0] == name
    assert service["image"] == "spot3d"
    # One builds it; the others must not look for it in a registry, where somebody else's may have its name.
    assert ("build" in service) == (service["pull_policy"] != "never") == (name == "router")


@pytest.mark.parametrize("stage", STAGES)
def test_environment_holds_valid_settings(stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in SERVICES[stage]["environment"].items():
        monkeypatch.setenv(name, resolved(text))
    link = load_settings().link
    meeting = f"unixsock-stream/{SERVICES['router']['command'][2]}"
    assert (link.robot, link.connect, link.delivery) == ("robot", (meeting,), "lossless")


def test_a_dashboard_is_an_onlooker_that_no_stage_waits_for() -> None:
    stage, dashboard = (SERVICES[name]["environment"] for name in ("fusion", "dashboard"))
    assert dashboard == stage | {"SPOT3D_LINK__CONNECT": '["tcp/router:7447"]'}


def test_router_is_closed_to_the_network() -> None:
    assert [resolved(port) for port in SERVICES["router"]["ports"]] == ["127.0.0.1:7447:7447"]


def test_a_recording_keeps_its_name_and_is_never_made() -> None:
    (bound,) = [volume for volume in SERVICES["source"]["volumes"] if isinstance(volume, dict)]
    assert bound["bind"] == {"create_host_path": False}
    assert bound["target"] == SERVICES["source"]["command"][1] == "/recording/${SPOT3D_DATA:-}"


@pytest.mark.parametrize("stage", SERVICES)
def test_command_is_one_of_the_command_line(stage: str) -> None:
    from typer.main import get_command

    from spot3d.cli.app import app

    arguments = SERVICES[stage]["command"]
    command = get_command(app).commands[arguments[0]]
    context = command.make_context(arguments[0], list(arguments[1:]), resilient_parsing=True)
    assert context.args == []


def test_compose_accepts_the_file() -> None:
    docker = shutil.which("docker")
    if docker is None or subprocess.run([docker, "compose", "version"], capture_output=True).returncode != 0:
        pytest.skip("no docker client with the compose plugin")
    environment = {"PATH": str(Path(docker).parent)}
    checked = subprocess.run(
        [docker, "compose", "config", "--quiet"], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stderr
