"""A drone and a ground station: two groups of processes that share nothing but the ground router's address.

On the drone: a router, source, pose, proposals, heatmap. On the ground: a router, segments and fusion. Heat and
pose cross.
"""

import json
import os
import queue
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
import zenoh

from spot3d.dataflow.process_use import SINGLE_THREADED
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Objects, Progress, decode, key

DEPLOY = Path(__file__).parents[2] / "deploy"
ROBOT = "drone"
FRAMES = 12
LIMIT_S = 120.0
"""Most of it is for compiling kernels, where they are not cached yet."""

# Ends with its parent, whose end of the pipe closes.
ROUTER = """
import sys, zenoh
config = zenoh.Config.from_file(sys.argv[1])
for path, value in zip(sys.argv[2::2], sys.argv[3::2]):
    config.insert_json5(path, value)
with zenoh.open(config):
    print("open", flush=True)
    sys.stdin.read()
"""
STAGE = """
import importlib, json, sys
from spot3d.settings import load_settings
stage = sys.argv[1]
settings = load_settings(overrides=json.loads(sys.argv[2]))
process = importlib.import_module(f"spot3d.{stage}.process")
if stage == "source":
    from spot3d.source.sequences import open_source
    process.run(settings.link, settings.source, open_source("scene", frames=int(sys.argv[3]), halved=True))
else:
    process.run(settings.link, getattr(settings, stage))
"""


@contextmanager
def running(program: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A Python process that is gone when this ends: by the closed pipe (routers) or SIGTERM (stages)."""
    environment = {name: text for name, text in os.environ.items() if not name.startswith("SPOT3D_")}
    command = [sys.executable, "-c", program, *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment | SINGLE_THREADED) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


def router(name: str, **values: object) -> list[str]:
    """Arguments of ROUTER: a configuration of deploy/zenoh with endpoints of this test."""
    texts = [(path.replace("_", "/"), json.dumps(value)) for path, value in values.items()]
    return [str(DEPLOY / "zenoh" / f"{name}.json5"), *(part for pair in texts for part in pair)]


def overrides(endpoint: str, **link: object) -> str:
    """Settings of a stage at a router: lossless, poses from the frames."""
    return json.dumps(
        {
            "link": {"robot": ROBOT, "connect": [endpoint], "delivery": "lossless", **link},
            "pose": {"provider": "given"},
        }
    )


@pytest.fixture
def results() -> Iterator[tuple[Objects, Progress, subprocess.Popen[str]]]:
    """The ground's last words about a short recording that the drone plays, and the drone's source."""
    drone_at, ground_at = free_loopback_endpoint(), free_loopback_endpoint()
    objects: queue.SimpleQueue[Objects] = queue.SimpleQueue()
    progress: queue.SimpleQueue[Progress] = queue.SimpleQueue()

    def note_objects(sample: zenoh.Sample) -> None:
        message = decode(sample.payload.to_bytes(), Objects)
        if message.complete:
            objects.put(message)

    def note_progress(sample: zenoh.Sample) -> None:
        message = decode(sample.payload.to_bytes(), Progress)
        if message.complete:
            progress.put(message)

    with ExitStack() as stack:
        ground = stack.enter_context(running(ROUTER, *router("ground", listen_endpoints=[ground_at])))
        drone = stack.enter_context(
            running(
                ROUTER,
                *router("drone", listen_endpoints=[drone_at], connect_endpoints=[f"{ground_at}#so_sndbuf=65536"]),
            )
        )
        for process in (ground, drone):
            assert process.stdout is not None
            assert process.stdout.readline() == "open\n"
        session = stack.enter_context(open_session(LinkSettings(robot=ROBOT, connect=(ground_at,))))
        session.declare_subscriber(key(ROBOT, "fusion/objects"), note_objects)
        session.declare_subscriber(key(ROBOT, "fusion/progress"), note_progress)
        for stage in ("segments", "fusion"):
            stack.enter_context(running(STAGE, stage, overrides(ground_at)))
        for stage in ("pose", "proposals"):
            stack.enter_context(running(STAGE, stage, overrides(drone_at)))
        stack.enter_context(running(STAGE, "heatmap", overrides(drone_at, thin_link=True)))
        source = stack.enter_context(running(STAGE, "source", overrides(drone_at), str(FRAMES)))
        yield objects.get(timeout=LIMIT_S), progress.get(timeout=LIMIT_S), source


def test_every_frame_of_the_drone_is_fused_on_the_ground(
    results: tuple[Objects, Progress, subprocess.Popen[str]],
) -> None:
    objects, progress, source = results
    assert (progress.fused, dict(progress.skipped)) == (FRAMES, {})
    assert objects.frame_count == FRAMES
    assert [np.isfinite(found.centre).all() and (found.size > 0).all() for found in objects.objects] == [True] * len(
        objects.objects
    )
    assert source.wait(timeout=LIMIT_S) == 0
