"""docker-compose.yml: a locked-down container for each stage, with commands and settings that exist."""

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


def resolved(text: str) -> str:
    """`text` as compose reads it with nothing set: ${NAME:-default} becomes the default."""
    return re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", text)


def test_one_container_for_each_stage_and_a_router() -> None:
    assert set(SERVICES) == {*STAGES, "router", "dashboard"}
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
    assert all(volume.endswith(":ro") for volume in service.get("volumes", []))


@pytest.mark.parametrize("stage", STAGES)
def test_stage_runs_its_own_command_in_its_own_image(stage: str) -> None:
    service = SERVICES[stage]
    assert service["command"][0] == stage
    assert service["build"]["args"] == {"STAGE": stage}
    assert service["image"] == f"spot3d-{stage}"
    assert (ROOT / service["build"]["dockerfile"]).is_file()


@pytest.mark.parametrize("stage", STAGES)
def test_environment_holds_valid_settings(stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in SERVICES[stage]["environment"].items():
        monkeypatch.setenv(name, resolved(text))
    link = load_settings().link
    assert (link.robot, link.connect, link.delivery) == ("robot", ("tcp/router:7447",), "lossless")


def test_mounted_files_exist() -> None:
    files = [volume.split(":")[0] for volume in SERVICES["router"]["volumes"]]
    assert files
    assert [file for file in files if not (ROOT / file).is_file()] == []


def test_router_is_pinned_and_closed_to_the_network() -> None:
    router = SERVICES["router"]
    assert re.fullmatch(r"eclipse/zenoh:\d+\.\d+\.\d+", router["image"])
    assert [resolved(port) for port in router["ports"]] == ["127.0.0.1:7447:7447"]
    assert router["user"].split(":")[0] != "0"


@pytest.mark.parametrize("stage", STAGES)
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
    environment = {"SPOT3D_DATA": "/data", "PATH": str(Path(docker).parent)}
    checked = subprocess.run(
        [docker, "compose", "config", "--quiet"], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stderr
