"""The stack of docker-compose.yml in a real Docker Engine: `make test-containers`.

The tests stand in the order of a day with it, and each builds on the one before. Two recordings go through one running
stack: one from a folder that has its intrinsics by its name, and one that the source makes itself.
"""

import json
import logging
import os
import shutil
import time
from collections.abc import Iterator

import numpy as np
import pytest
from stack import HERE, ROOT, compose, inside, inspect, streams, wait

from spot3d.bench.recording import write_recording
from spot3d.source.scene.scene import Scene
from spot3d_schemas import STAGES

log = logging.getLogger(__name__)

FRAMES = 60
RECORDING = "rgbd_dataset_freiburg3_made_up"
STAYING = (*(stage for stage in STAGES if stage != "source"), "router", "results")
"""The services that do not end with the recording."""

STUCK = """
import time, zenoh
config = zenoh.Config()
config.insert_json5("mode", "\\"client\\"")
config.insert_json5("connect/endpoints", "[\\"tcp/127.0.0.1:7447\\"]")
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("spot3d/robot/heatmap/heat", zenoh.handlers.FifoChannel(1))
    print("ready", flush=True)
    subscriber.recv()
    print("stuck", flush=True)
    time.sleep(600)
"""
"""Comes by the network, as whoever comes from outside."""

pytestmark = pytest.mark.skipif("SPOT3D_CONTAINERS" not in os.environ, reason="containers: make test-containers")


@pytest.fixture(scope="module")
def recording() -> str:
    """A recording of the built-in scene, as TUM's are, relative to the compose file."""
    shutil.rmtree(HERE, ignore_errors=True)
    folder = HERE / RECORDING
    write_recording(folder, list(Scene(0, frames=FRAMES)), FRAMES)
    (folder / "intrinsics.txt").unlink()
    return str(folder.relative_to(ROOT))


@pytest.fixture(scope="module", autouse=True)
def _stack(recording: str) -> Iterator[None]:
    compose("build", limit_s=3000)
    compose("down", "--volumes", "--timeout", "5")
    yield
    compose("down", "--volumes", "--timeout", "5")


def test_commands_that_play_nothing_need_no_recording() -> None:
    for command in (("ps",), ("logs",), ("config", "--quiet")):
        compose(*command)


@pytest.mark.parametrize(
    ("settings", "said"), [({}, "SPOT3D_DATA-is-not-set"), ({"SPOT3D_DATA": "out/mistyped"}, "out/mistyped")]
)
def test_a_mistyped_recording_is_told_and_no_folder_is_made(settings: dict[str, str], said: str) -> None:
    with pytest.raises(AssertionError, match=f"bind source path does not exist: .*{said}"):
        compose("create", "source", **settings)
    assert not (ROOT / said).exists()


def test_a_recording_is_fused_and_its_results_are_kept(recording: str) -> None:
    compose("up", "--detach", SPOT3D_DATA=recording, limit_s=600)
    assert inspect("source", "{{.State.Status}}") in ("running", "exited")
    wait(lambda: inspect("source", "{{.State.Status}} {{.State.ExitCode}}") == "exited 0")
    wait(lambda: any(told["complete"] for told in streams()))
    (told,) = streams()
    assert (told["fused"], told["skipped"], told["robot"]) == (FRAMES, {}, "robot")
    assert told["objects"] >= 3
    names = {path.name for path in told["folder"].iterdir()}
    assert names >= {"objects.json", "objects.jsonl", "heatmap.ply", "trajectory.txt", "overview.png"}
    assert f"results in /results/{told['folder'].name}" in compose("logs", "results")


def test_another_recording_through_the_running_stack_is_another_scene() -> None:
    (first,) = streams()
    play = ("source", "scene:1", "--frames", str(FRAMES))
    compose("run", "--rm", "--no-deps", "source", *play, SPOT3D_DATA=".")
    wait(lambda: len(streams()) == 2 and all(told["complete"] for told in streams()))
    second = streams()[1]
    assert (second["fused"], second["skipped"]) == (FRAMES, {})
    assert second["stream"] != first["stream"]
    centres = [
        np.array([item["centre"] for item in json.loads((told["folder"] / "objects.json").read_text())["objects"]])
        for told in (first, second)
    ]
    assert len(centres[1]) >= 3
    assert not np.isin(centres[1], centres[0]).any()


def test_nobody_waits_for_an_onlooker_that_is_stuck() -> None:
    inside("router", "sh", "-c", f"python -c '{STUCK}' > /tmp/stuck 2>&1 &")
    wait(lambda: "ready" in inside("router", "cat", "/tmp/stuck"))
    play = ("source", "scene:2", "--frames", str(FRAMES))
    compose("run", "--rm", "--no-deps", "source", *play, SPOT3D_DATA=".")
    wait(lambda: len(streams()) == 3 and all(told["complete"] for told in streams()))
    assert (streams()[2]["fused"], streams()[2]["skipped"]) == (FRAMES, {})
    assert "stuck" in inside("router", "cat", "/tmp/stuck")


@pytest.mark.parametrize("service", STAYING)
def test_containers_are_locked_down(service: str) -> None:
    assert inside(service, "id", "-u").strip() == "10001"
    status = inside(service, "cat", "/proc/self/status")
    assert "CapBnd:\t0000000000000000" in status
    assert "NoNewPrivs:\t1" in status
    assert " / overlay ro," in inside(service, "cat", "/proc/mounts")
    assert inspect(service, "{{.State.Health.Status}} {{.RestartCount}}") == "healthy 0"


def test_nothing_was_compiled_and_what_would_be_outlives_a_restart() -> None:
    folder = f"/var/cache/spot3d/{inside('fusion', 'cat', '/opt/spot3d/kernels.id').strip()}"
    assert inside("fusion", "diff", "-rq", "/opt/spot3d/kernels", folder) == ""
    inside("fusion", "touch", f"{folder}/compiled-here")
    compose("up", "--detach", "--force-recreate", "--no-deps", "fusion")
    wait(lambda: inspect("fusion", "{{.State.Health.Status}}") == "healthy")
    assert "compiled-here" in inside("segments", "ls", folder)
    assert {"fusion.snapshot", "pose.snapshot"} <= set(inside("fusion", "ls", "/var/lib/spot3d/robot").split())


def test_a_frozen_stage_is_started_again() -> None:
    inside("proposals", "sh", "-c", "kill -STOP $(cut -d ' ' -f 2 /tmp/heartbeat)")
    after_s = wait(lambda: inspect("proposals", "{{.RestartCount}} {{.State.Health.Status}}") == "1 healthy", 120)
    log.info("frozen to healthy again: %.0f s", after_s)


def test_what_is_no_recording_is_told_and_not_tried_for_ever() -> None:
    (HERE / "nothing").mkdir()
    compose("up", "--detach", "--no-deps", "source", SPOT3D_DATA=str(HERE / "nothing"))
    wait(lambda: inspect("source", "{{.RestartCount}} {{.State.Status}} {{.State.ExitCode}}") == "3 exited 2")
    assert f"error: /recording{HERE}/nothing is not a recording" in compose("logs", "source")


def test_any_setting_reaches_the_stages() -> None:
    (HERE / "settings.env").write_text("SPOT3D_PROPOSALS__MAX_BOXES=77\n")
    run = ("run", "--rm", "--no-deps", "proposals", "settings")
    assert "max_boxes = 77 " in compose(*run, SPOT3D_SETTINGS="out/containers/settings.env")


def test_all_end_as_they_should_and_soon() -> None:
    assert "Traceback" not in compose("logs", "--no-color")
    took_s = -time.monotonic()
    compose("stop")
    took_s += time.monotonic()
    assert {service: inspect(service, "{{.State.ExitCode}}") for service in STAYING} == dict.fromkeys(STAYING, "0")
    assert took_s < 30
    log.info("stopped in %.1f s", took_s)
