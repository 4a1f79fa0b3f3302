"""`spot3d run` with real processes: same result as in one process; nothing is left behind, however it ends."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from spot3d.dataflow.ledger import IN_RESTART, NEVER_ARRIVED
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.fusion.snapshot import read_account
from spot3d.run.silence import SILENT_S
from spot3d.settings import without_settings
from spot3d_schemas import Objects, Progress, decode, key
from waiting import wait_until

STAGES = {"source", "pose", "proposals", "heatmap", "segments", "fusion"}
VERTEX_BYTES = 23
"""x, y, z, heat and frequency in four bytes each, colour in three."""
START_S = 90.0
"""A first start may compile kernels."""


def arguments(out: Path, frames: int, *more: str) -> list[str]:
    return [
        *(sys.executable, "-m", "spot3d", "run", "scene", "--half"),
        *("--frames", str(frames), "--out", str(out), *more),
    ]


def stages_of(parent: int) -> dict[str, int]:
    """Pid of each running stage of the run `parent`: forked from its fork server, and named after the stage."""
    found = {}
    parents: dict[int, int] = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = status.read_text().partition("(")[2].rpartition(") ")
        except OSError:
            continue  # it has just ended
        state, its_parent = rest.split()[:2]
        parents[int(status.parent.name)] = int(its_parent)
        for stage in STAGES:
            if state != "Z" and name == f"spot3d {stage}"[:15]:  # as much of a name as the system keeps
                found[int(status.parent.name)] = stage
    return {stage: pid for pid, stage in found.items() if parents.get(parents[pid]) == parent}


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class Run:
    """A run in the background, and what it says."""

    def __init__(self, out: Path, frames: int, *more: str) -> None:
        self.out = out
        self.endpoint = free_loopback_endpoint()
        self.process = subprocess.Popen(
            arguments(out, frames, "--listen", self.endpoint, *more),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=without_settings(os.environ) | {"PYTHONUNBUFFERED": "1"},
        )
        self.said = ""
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said += line

    def wait_for_stages(self) -> dict[str, int]:
        wait_until(lambda: set(stages_of(self.process.pid)) == STAGES, "all stages are started", START_S)
        return stages_of(self.process.pid)


@contextmanager
def running(out: Path, frames: int, *more: str) -> Iterator[Run]:
    if not Path("/proc/self/stat").exists():
        pytest.skip("needs /proc to see the processes")
    run = Run(out, frames, *more)
    children: dict[str, int] = {}
    try:
        children = run.wait_for_stages()
        yield run
    finally:
        run.process.kill()
        run.process.wait()
        run.reader.join(10)
        assert run.process.stdout is not None
        run.process.stdout.close()
        for pid in {*children.values()}:
            if is_running(pid):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def endless(tmp_path) -> Iterator[Run]:
    with running(tmp_path / "out", 100_000) as run:
        yield run


def test_processes_give_the_same_objects_as_one_process(tmp_path):
    alone, together = tmp_path / "alone", tmp_path / "together"
    # Another noise than the default: what does not come along with frame and heat shows in the results.
    environment = without_settings(os.environ) | {"SPOT3D_SOURCE__DEPTH_NOISE": "d435"}
    for out, more in ((alone, ["--in-process"]), (together, [])):
        done = subprocess.run(
            arguments(out, 40, *more), capture_output=True, text=True, timeout=START_S, check=False, env=environment
        )
        assert done.returncode == 0, done.stderr
        assert "40 of 40 frames" in done.stdout
        assert "none dropped" in done.stdout
    assert (alone / "objects.json").read_bytes() == (together / "objects.json").read_bytes()
    assert json.loads((together / "objects.json").read_text())["frame_count"] == 40
    updates = (together / "objects.jsonl").read_text().splitlines()
    assert len(updates) >= 4
    assert len(json.loads(updates[-1])["objects"]) >= 10, "there is something to differ in"
    assert (alone / "objects.jsonl").read_bytes() == (together / "objects.jsonl").read_bytes()
    assert (alone / "trajectory.txt").read_bytes() == (together / "trajectory.txt").read_bytes()
    assert (alone / "heatmap.ply").read_bytes() == (together / "heatmap.ply").read_bytes()
    report = json.loads((together / "report.json").read_text())
    assert report["proposals"] == json.loads((alone / "report.json").read_text())["proposals"]
    assert set(report["proposals"]) == {"accepted", "masked", "rejected"}
    assert report["keyframes"] == json.loads((alone / "report.json").read_text())["keyframes"] == 5
    assert report["frames"]["fused"] == 40
    assert report["drops"] == {}
    assert set(report["stages"]) == STAGES
    assert report["latency_ms"]["source to fused"]["p50"] > 0
    assert all(stage["step_ms"]["p50"] > 0 for stage in report["stages"].values())
    assert (together / "overview.png").stat().st_size > 50_000
    assert (together / "settings.toml").exists()


def test_a_killed_stage_is_started_again_and_ctrl_c_ends_all(endless):
    fused: list[int] = []
    updates: list[int] = []
    with open_session(LinkSettings(connect=(endless.endpoint,))) as session:
        subscriber = session.declare_subscriber(
            key("robot", "fusion/progress"),
            lambda sample: fused.append(decode(sample.payload.to_bytes(), Progress).fused),
        )
        others = session.declare_subscriber(
            key("robot", "fusion/objects"),
            lambda sample: updates.append(decode(sample.payload.to_bytes(), Objects).frame_count),
        )
        wait_until(lambda: bool(fused) and bool(updates), "frames are fused, and objects found", START_S)
        before = endless.wait_for_stages()
        at_kill = fused[-1]
        os.kill(before["heatmap"], signal.SIGKILL)
        wait_until(lambda: "heatmap was killed by SIGKILL; restarted" in endless.said, "the death is told", 5)
        wait_until(lambda: fused[-1] >= at_kill + 5, "frames are fused again", 40)
        assert fused == sorted(fused), "fusion has lost nothing that it had fused"
        subscriber.undeclare()
        others.undeclare()
    after = endless.wait_for_stages()
    assert {stage for stage in STAGES if after[stage] != before[stage]} == {"heatmap"}

    endless.process.send_signal(signal.SIGINT)
    wait_until(lambda: not any(map(is_running, after.values())), "every stage has ended", 8)
    assert endless.process.wait(20) == 130
    wait_until(lambda: "(interrupted; not fused: " in endless.said, "so does its last line say", 5)
    objects = json.loads((endless.out / "objects.json").read_text())
    assert objects["frame_count"] > 0
    report = json.loads((endless.out / "report.json").read_text())
    assert report["interrupted"]
    assert report["restarts"] == {"heatmap": 1}
    assert report["frames"]["fused"] >= at_kill + 5
    assert (endless.out / "heatmap.ply").stat().st_size > 1000
    assert (endless.out / "trajectory.txt").stat().st_size > 0
    assert (endless.out / "overview.png").exists()


def test_a_stage_that_hangs_is_told_killed_and_started_again(endless):
    told = f"segments has not responded for {SILENT_S:.0f} s; it hangs and is killed"
    before = endless.wait_for_stages()
    # Only what has said something can hang: until then a stage may compile.
    with open_session(LinkSettings(connect=(endless.endpoint,))) as session:
        heard: list[object] = []
        subscriber = session.declare_subscriber(key("robot", "segments/health"), heard.append)
        wait_until(lambda: bool(heard), "segments is on line", START_S)
        subscriber.undeclare()
    os.kill(before["segments"], signal.SIGSTOP)
    wait_until(lambda: "segments was killed by SIGKILL; restarted" in endless.said, "its death is told", 60)
    assert told in endless.said
    assert endless.said.count("has not responded") == 1, "those that wait for it do not hang"
    after = endless.wait_for_stages()
    assert {stage for stage in STAGES if after[stage] != before[stage]} == {"segments"}
    endless.process.send_signal(signal.SIGINT)
    assert endless.process.wait(20) == 130
    report = json.loads((endless.out / "report.json").read_text())
    assert report["events"][0] == told
    assert report["restarts"] == {"segments": 1}


def test_every_frame_is_accounted_for_where_fusion_and_then_the_source_are_killed(tmp_path):
    frames, words = 80, list[Progress]()
    with (
        running(tmp_path / "out", frames, "--pose", "truth", "--rate", "10") as run,
        open_session(LinkSettings(connect=(run.endpoint,))) as session,
    ):
        subscriber = session.declare_subscriber(
            key("robot", "fusion/progress"), lambda sample: words.append(decode(sample.payload.to_bytes(), Progress))
        )
        wait_until(lambda: bool(words) and words[-1].fused >= 20, "frames are fused", START_S)
        os.kill(run.wait_for_stages()["fusion"], signal.SIGKILL)
        wait_until(lambda: "fusion was killed by SIGKILL" in run.said, "fusion's death is told")
        words.clear()
        wait_until(lambda: bool(words) and words[-1].fused >= 5, "frames are fused again")
        os.kill(run.wait_for_stages()["source"], signal.SIGKILL)
        wait_until(lambda: "source was killed by SIGKILL" in run.said, "the source's death is told")
        subscriber.undeclare()
        assert run.process.wait(START_S) == 0
    counts = json.loads((run.out / "report.json").read_text())["frames"]
    assert counts["fused"] + sum(counts["skipped"].values()) == counts["input"] == frames
    assert counts["skipped"].keys() <= {NEVER_ARRIVED, IN_RESTART}, "fusion itself knows what it has forgotten"
    assert counts["skipped"], "what fusion had not kept is lost"
    assert "none dropped" not in run.said


def test_stages_end_with_a_run_that_is_killed(endless):
    children = endless.wait_for_stages()
    endless.process.kill()
    wait_until(lambda: not any(map(is_running, children.values())), "every stage has ended", 20)


def test_a_run_that_is_killed_leaves_the_results_of_its_last_ten_seconds(endless):
    children = endless.wait_for_stages()
    kept = endless.out / "objects.json"
    # heatmap.ply is written last: all are there, and each that follows takes the place of one.
    wait_until((endless.out / "heatmap.ply").exists, "results are kept as the run goes", START_S)
    wait_until(lambda: json.loads(kept.read_text())["frame_count"] > 0, "objects are kept, too", START_S)
    endless.process.kill()
    wait_until(lambda: not any(map(is_running, children.values())), "every stage has ended", 20)
    report = json.loads((endless.out / "report.json").read_text())
    assert "was killed" in report["error"]
    assert report["frames"]["fused"] > 0
    objects = json.loads(kept.read_text())
    path = np.loadtxt(endless.out / "trajectory.txt", ndmin=2)
    assert path.shape == (len(path), 8)
    cloud = (endless.out / "heatmap.ply").read_bytes()
    count = int(cloud.partition(b"element vertex ")[2].split()[0])
    assert len(cloud.partition(b"end_header\n")[2]) == count * VERTEX_BYTES > 0
    updates = [json.loads(line) for line in (endless.out / "objects.jsonl").read_text().splitlines()]
    assert updates[-1]["frame_count"] >= objects["frame_count"], "each update is written as it comes"
    told, _ = read_account(endless.out / "snapshots" / "robot" / "fusion.snapshot")
    assert told.fused > 0


SLOW_VIEWER = """
import sys, time, zenoh
from zenoh.handlers import FifoChannel
from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings
while True:
    try:
        session = zenoh.open(zenoh_config(LinkSettings(connect=(sys.argv[1],), delivery="lossless")))
        break
    except zenoh.ZError:
        time.sleep(0.05)
subscriber = session.declare_subscriber("spot3d/robot/heatmap/heat", FifoChannel(1))
while True:
    subscriber.recv()
    print("seen", flush=True)
    time.sleep(1)
"""


def test_a_slow_onlooker_of_a_lossless_run_is_not_waited_for(tmp_path):
    frames, endpoint, environment = 60, free_loopback_endpoint(), without_settings(os.environ)
    command = arguments(tmp_path / "out", frames, "--pose", "truth", "--listen", endpoint)
    viewer = subprocess.Popen([sys.executable, "-c", SLOW_VIEWER, endpoint], stdout=subprocess.PIPE, text=True)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False, env=environment)
    finally:
        viewer.kill()
        seen = viewer.communicate()[0].count("seen")
    assert done.returncode == 0, done.stderr
    assert f"{frames} of {frames} frames" in done.stdout
    assert "none dropped" in done.stdout
    assert 0 < seen < frames / 2
