"""`spot3d run --pose TOPIC`: someone else's odometry, on a key of its own."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import zenoh
from zenoh.handlers import FifoChannel

from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d.pose.motion import checked_pose
from spot3d.settings import without_settings
from spot3d_schemas import Frame, Pose, decode, encode, encoding, key

FRAMES = 8
ROBOT, TOPIC = "guided", "vio/camera/pose"
LIMIT_S = 120.0
"""A first start may compile kernels."""


def start(out: Path, *more: str) -> "subprocess.Popen[str]":
    settings = out.with_suffix(".toml")
    # Poses on a topic are taken as they are: so shall those of the input be.
    settings.write_text(f'[link]\nrobot = "{ROBOT}"\n[pose]\ngiven_sigma = 0\n', encoding="utf-8")
    command = [sys.executable, "-m", "spot3d", "run", "scene", "--half", "--frames", str(FRAMES)]
    command += ["--settings", str(settings), "--out", str(out), *more]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=without_settings(os.environ))


def finish(process: "subprocess.Popen[str]") -> str:
    try:
        said, errors = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    return said


def connected(process: "subprocess.Popen[str]", endpoint: str) -> zenoh.Session:
    """A session with the run's router, which takes a moment to be there."""
    end_s = time.monotonic() + LIMIT_S
    while time.monotonic() < end_s and process.poll() is None:
        try:
            return zenoh.open(zenoh_config(LinkSettings(connect=(endpoint,), shared_memory=False)))
        except zenoh.ZError:
            time.sleep(0.05)
    raise TimeoutError(f"the run's router did not come; exit code {process.poll()}")


def play_odometry(session: zenoh.Session, process: "subprocess.Popen[str]") -> int:
    """Answer every frame with its true pose, as an odometry of the robot's own would; returns how many there were."""
    frames = session.declare_subscriber(key(ROBOT, "source/frame"), FifoChannel(4))
    poses = session.declare_publisher(TOPIC, encoding=encoding(Pose))
    end_s, count = time.monotonic() + LIMIT_S, 0
    while count < FRAMES and process.poll() is None and time.monotonic() < end_s:
        sample = frames.handler.try_recv()
        if sample is None:
            time.sleep(0.005)
            continue
        frame = decode(sample.payload.to_bytes(), Frame)
        assert frame.T_world_camera is not None
        T_world_camera = checked_pose(frame.T_world_camera)
        assert T_world_camera is not None
        now_ns = time.time_ns()
        header = frame.header.with_hop("vio", now_ns, now_ns)
        pose = Pose(header=header, T_world_camera=T_world_camera, status="ok", reason="", provider="vio")
        poses.put(encode(pose))
        count += 1
    return count


def test_poses_on_a_topic_give_the_same_objects_as_the_same_poses_of_the_input(tmp_path):
    alone, guided = tmp_path / "alone", tmp_path / "guided"
    finish(start(alone, "--in-process", "--pose", "truth"))
    endpoint = free_loopback_endpoint()
    process = start(guided, "--pose", TOPIC, "--listen", endpoint)
    try:
        with connected(process, endpoint) as session:
            assert play_odometry(session, process) == FRAMES
            said = finish(process)
    finally:
        process.kill()
        process.wait()
    assert f"{FRAMES} of {FRAMES} frames" in said
    assert (guided / "objects.json").read_bytes() == (alone / "objects.json").read_bytes()
    assert (guided / "trajectory.txt").read_bytes() == (alone / "trajectory.txt").read_bytes()
    report = json.loads((guided / "report.json").read_text())
    assert report["frames"]["fused"] == FRAMES
    assert report["restarts"] == {}
    assert not (guided / "logs" / "pose.log").exists(), "no pose stage was started"
