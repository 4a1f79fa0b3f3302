"""`spot3d doctor`: what is a problem, what is to be done, and one real robot."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from authority import link as certified
from authority import make_fleet
from typer.testing import CliRunner

from spot3d import __version__
from spot3d.cli.app import app
from spot3d.dataflow.about import zenoh_version
from spot3d.dataflow.kernel_cache import kernels_missing, stage_kernels_missing
from spot3d.dataflow.node import Node
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.doctor.examine import examine
from spot3d.doctor.finding import Finding
from spot3d.doctor.others import Answer, flows, look_at, states
from spot3d.doctor.this_device import certificate, disk, shared_memory
from spot3d_schemas import STAGES, About, Header, Health, Proposals, alive_key

ALL = dict.fromkeys(STAGES, True)
PLENTY = 10**11


def answer(stage: str = "pose", offset_ms: float = 0.0, within_ms: float = 1.0, **fields: object) -> Answer:
    told = {
        "stage": stage,
        "pid": 1,
        "host": "drone",
        "spot3d": __version__,
        "zenoh": zenoh_version(),
        "python": "3.11.7",
        "time_ns": 5,
        "kernels_missing": 0,
        "shared_memory_bytes": PLENTY,
        "disk": "/var",
        "disk_free_bytes": PLENTY,
        "certificate_until_ns": None,
    }
    header = Header(robot="robot", seq=0, stamp_ns=1, frame_id=stage)
    return Answer(About(header=header, **told | fields), offset_ms, within_ms)


def said(answers: list[Answer], alive: dict[str, bool] = ALL) -> dict[str, Finding]:
    return {finding.what: finding for finding in look_at(answers, alive) if finding.level != "ok"}


FLEET = [answer(stage) for stage in STAGES]


def test_nothing_is_said_of_what_is_well() -> None:
    assert said(FLEET) == {}


@pytest.mark.parametrize(
    ("answers", "what", "level", "words"),
    [
        ([answer(stage, host="ground", spot3d="9.9") for stage in STAGES], "versions on ground", "problem", "d 9.9"),
        ([*FLEET, answer(pid=2)], "stages", "problem", "pose runs 2 times: drone (1), drone (2)"),
        (FLEET[1:], "stages", "note", "do not state their versions: source"),
        ([answer(stage, 80.0) for stage in STAGES], "clock on drone", "problem", "+80.0 ms"),
        ([answer(stage, -3.6e6) for stage in STAGES], "clock on drone", "problem", "about 1 hour behind this device's"),
        ([*FLEET[1:], answer("source", 3.6e6, 2.0)], "clock on drone", "problem", "about 1 hour ahead of"),
        ([answer(stage, -80.0, 40.0) for stage in STAGES], None, "", ""),
        ([answer(stage, -80.0, 90.0) for stage in STAGES], "clock on drone", "note", "+- 90.0 ms"),
        ([*FLEET[1:], answer("source", 80.0, 90.0)], None, "", ""),
        (
            [*FLEET[1:], answer("source", kernels_missing=2)],
            "kernels on drone",
            "note",
            "2 modules have kernels that are not compiled",
        ),
        ([*FLEET[1:], answer("source", shared_memory_bytes=2**26)], "shared memory on drone", "problem", "67 MB"),
        ([*FLEET[1:], answer("source", shared_memory_bytes=0)], "shared memory on drone", "note", "off"),
        ([*FLEET[1:], answer("source", disk_free_bytes=10**9)], "disk on drone", "problem", "1.0 GB left in /var"),
        ([*FLEET[1:], answer("source", certificate_until_ns=10**18)], "certificates on drone", "problem", "2001-09-09"),
    ],
)
def test_what_is_wrong_is_said_with_what_to_do(answers: list[Answer], what: str | None, level: str, words: str) -> None:
    findings = said(answers)
    assert set(findings) == ({what} if what else set())
    if what:
        assert findings[what].level == level
        assert words in findings[what].text
        assert findings[what].remedy


def test_what_a_stage_says_of_itself_is_a_problem() -> None:
    """All were alive and well for the doctor while the frames of a camera program were refused."""
    fields = {"drops": {}, "events": {}} | dict.fromkeys(("received", "published", "errors", "threads"), 0)
    times = dict.fromkeys(("rate_hz", "latency_ms_p50", "latency_ms_p99", "step_ms_p50", "step_ms_p99"))
    header = Header(robot="robot", seq=0, stamp_ns=1, frame_id="pose")
    numbers = {"pid": 1, "uptime_s": 1.0, "last_error": "", "cpu_s": 0.0, "rss_bytes": 1}
    well = Health(header=header, stage="pose", **fields, **times, **numbers)
    lost = well.model_copy(update={"state": "the timestamps of frames do not advance"})
    assert states({"pose": [lost, well], "fusion": [well], "source": []}) == []
    (found,) = states({"pose": [well, lost], "fusion": [well], "source": []})
    assert (found.level, found.what, found.text) == ("problem", "pose", lost.state)


def test_stages_that_are_not_there_are_named() -> None:
    assert said([], {"pose": True})["stages"].text == "not alive: source, proposals, heatmap, segments, fusion"


def test_this_device(tmp_path: Path) -> None:
    fleet = make_fleet(tmp_path / "fleet")
    assert "has expired" in certificate(certified(fleet, "expired")).text
    assert certificate(certified(fleet, "drone")).level == "problem", "it is valid for an hour"
    assert disk("/", 10**9, "here").level == "problem"
    assert shared_memory(PLENTY, "here").level == "ok"


def test_a_lossless_run_is_not_told_to_mend_its_shared_memory() -> None:
    """It has none, by intention, and its stages cannot say why."""
    finding = shared_memory(0, "on drone")
    assert (finding.level, "a lossless run" in finding.text) == ("note", True)
    assert "a lossless run does not use it" in finding.remedy


def test_kernels_are_missing_until_they_are_compiled_and_when_they_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    module = tmp_path / "edges.py"
    module.write_text("import x\n\n\n@kernel()\ndef thin(): ...\n")
    (tmp_path / "plain.py").write_text("# a kernel( is not defined here\n")
    assert kernels_missing(tmp_path) == [module]
    numba = pytest.importorskip("numba", reason="numba is not installed")
    module.write_text("from spot3d.kernel import kernel\n\n\n@kernel()\ndef twice(x):\n    return 2 * x\n")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    scope: dict[str, object] = {"__name__": "edges"}
    exec(compile(module.read_text(), str(module), "exec"), scope)
    scope["twice"](2.0)
    assert kernels_missing(tmp_path) == []
    namesake = tmp_path / "other" / "edges.py"
    namesake.parent.mkdir()
    namesake.write_text(module.read_text())
    os.utime(namesake, (1, 1))
    assert kernels_missing(tmp_path) == [namesake]
    later = time.time() + 10
    os.utime(module, (later, later))
    assert kernels_missing(tmp_path) == [module, namesake]


def test_kernels_of_other_inputs_are_not_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A demo compiles neither those of ROS bags nor those that register colour."""
    monkeypatch.setattr("spot3d.dataflow.kernel_cache._SERVICES", tmp_path)
    for module in ("source/ros/rvl.py", "pose/features.py"):
        (tmp_path / module).parent.mkdir(parents=True)
        (tmp_path / module).write_text("import x\n\n\n@kernel()\ndef decode(): ...\n")
    assert {stage: stage_kernels_missing(stage) for stage in STAGES if stage_kernels_missing(stage)} == {"pose": 1}


def health(seconds: int, sent: dict[str, int], size: int) -> Health:
    header = Header(robot="robot", seq=0, stamp_ns=seconds * 10**9, frame_id="pose")
    counts = dict.fromkeys(("pid", "received", "published", "errors", "rss_bytes", "threads"), 1)
    times = dict.fromkeys(("rate_hz", "latency_ms_p50", "latency_ms_p99", "step_ms_p50", "step_ms_p99"))
    return Health(
        header=header,
        stage="pose",
        uptime_s=1.0,
        cpu_s=1.0,
        drops={},
        events={},
        last_error="",
        sent=sent,
        sent_bytes={topic: size * count for topic, count in sent.items()},
        **counts,
        **times,
    )


def test_rates_are_those_between_two_health_messages() -> None:
    (pose,) = flows(health(10, {}, 300), health(12, {"pose/pose": 60}, 300))
    assert (pose.topic, pose.rate_hz, pose.bytes_per_s) == ("pose/pose", 30, 9000)
    assert flows(health(10, {"pose/pose": 1}, 1), health(10, {"pose/pose": 1}, 1)) == []


@contextmanager
def robot(endpoint: str) -> Iterator[None]:
    """Every stage's real node; proposals sends boxes, the others nothing."""
    stop = threading.Event()
    link = LinkSettings(connect=(endpoint,), health_interval_s=0.2)

    def send(node: Node) -> None:
        header = Header(robot="robot", seq=0, stamp_ns=1, frame_id="camera")
        while not stop.wait(0.05):
            boxes = np.zeros((0, 5), np.float32)
            node.publish("proposals/boxes", Proposals(header=node.numbered("proposals/boxes", header), boxes=boxes))

    with open_router((endpoint,)), ExitStack() as stack:
        for stage in STAGES:
            outputs = ("proposals/boxes",) if stage == "proposals" else ()
            node = stack.enter_context(Node(stage, link, stop, (), outputs))
            if outputs:
                sender = threading.Thread(target=send, args=(node,))
                stack.callback(sender.join)
                stack.callback(stop.set)
                sender.start()
        yield


def test_a_robot_that_is_well_and_one_that_is_not_there() -> None:
    endpoint = free_loopback_endpoint()
    arguments = ["doctor", "--connect", endpoint, "--seconds", "1.5"]
    with robot(endpoint):
        outcome = CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})
    lines = outcome.output.splitlines()
    assert f"ok      router: reached at {endpoint}" in lines
    assert f"ok      stages: all alive: {', '.join(STAGES)}" in lines
    assert any(line.startswith("ok      clock on ") for line in lines)
    (sent,) = [line.split() for line in lines if "proposals/boxes" in line]
    assert float(sent[1]) > 1
    problems = [line for line in lines if line.startswith("problem")]
    # Of this machine, which may have little room.
    assert all("disk" in line or "shared memory" in line for line in problems)
    assert outcome.exit_code == bool(problems)


def test_who_asks_for_a_robot_that_is_not_there_is_told_who_is() -> None:
    endpoint = free_loopback_endpoint()
    with open_router((endpoint,)) as session, session.liveliness().declare_token(alive_key("drone", "pose")):
        for name, told in (("drome", True), ("drone", False)):
            findings, _ = examine(LinkSettings(connect=(endpoint,), robot=name), 0.5)
            others = [finding.text for finding in findings if finding.what == "robots"]
            assert others == (["alive here: drone; choose one with --robot"] if told else [])


def test_no_router(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spot3d.doctor.examine._CONNECT_S", 0.2)
    outcome = CliRunner().invoke(app, ["doctor", "--connect", free_loopback_endpoint()], env={"COLUMNS": "200"})
    assert outcome.exit_code == 1
    assert "no answer" in outcome.output
