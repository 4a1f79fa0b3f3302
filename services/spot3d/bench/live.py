"""Live runs of the real processes over Zenoh, monitored from a separate session, and the table of them."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from spot3d.bench.material import Material
from spot3d.bench.recording import write_recording
from spot3d.dataflow.payload import arrived
from spot3d.dataflow.process_use import SINGLE_THREADED
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d.evaluate.table import Cell, Column, Table, columns
from spot3d.settings import load_settings
from spot3d_schemas import STAGES, Health, Progress, key

COLUMNS = (
    *(*columns("data", "size"), *columns("offered /s", "fused /s", digits=1)),
    *(*columns("frames", "fused"), *columns("p50 ms", "p99 ms", digits=0), Column("first fused s", 1)),
    *(Column("CPU cores", 2), Column("fusion MB", 0), *columns("not fused", "busy")),
)
_WHOLE = "source to fused"

Reading = tuple[float, float]

_POLL_S = 0.01
_LIMIT_S = 300.0
"""A run is given up this long after the time that the frames themselves take."""


@dataclass(slots=True)
class LiveRun:
    """Results of a live run.

    start_s: from the command to the first fused frame; rate_hz: frames fused a second from then to the last; cores:
    CPU seconds of all stages a second in that time; report: the run's report.json; error: why there is no result.
    """

    start_s: float | None = None
    rate_hz: float | None = None
    cores: float | None = None
    fused: float = 0
    report: dict[str, Any] = field(default_factory=dict)
    error: str = ""


def live_table(materials: Sequence[Material], rate_hz: float, seconds: float, say: Callable[[str], None]) -> Table:
    """A row for each material, written to disk and played live from there for `seconds`."""
    table = Table("live", f"The processes over Zenoh, live at {rate_hz:g} frames a second", COLUMNS)
    with tempfile.TemporaryDirectory(prefix="spot3d-bench-") as name:
        scratch = Path(name)
        for material in materials:
            recording = scratch / f"{material.data.replace(':', '-')}-{material.size}"
            say(f"live: {material.data}, {material.size}, {seconds:g} s ...")
            write_recording(recording, material.frames, max(1, round(rate_hz * seconds)))
            _add(table, material, rate_hz, live_run(str(recording), rate_hz, seconds, scratch / "out"))
    table.notes += [
        f"The first {len(materials[0]) if materials else 0} frames, played to and fro from uncompressed files.",
        "Latency: from sending by the source to fusing. First fused: from the command. CPU cores: CPU seconds per "
        "second of all stages from then on. Not fused: frames by reason; busy: messages that a stage skipped for "
        "newer ones.",
    ]
    return table


def _add(table: Table, material: Material, rate_hz: float, done: LiveRun) -> None:
    if done.error:
        table.notes.append(f"{material.data}, {material.size}: {done.error}")
    latency = done.report.get("latency_ms", {}).get(_WHOLE, {})
    stages = done.report.get("stages", {})
    played = done.report.get("frames", {}).get("input")
    cells: tuple[Cell, ...] = (
        *(material.data, material.size, rate_hz, done.rate_hz, played, round(done.fused)),
        *(latency.get("p50"), latency.get("p99"), done.start_s),
        done.cores,
        stages.get("fusion", {}).get("rss_mb"),
        _counts(done.report.get("frames", {}).get("skipped", {})),
        _counts({stage: _busy(reasons) for stage, reasons in done.report.get("drops", {}).items()}),
    )
    table.add(*cells)


def _busy(reasons: dict[str, int]) -> int:
    return sum(count for reason, count in reasons.items() if reason.endswith("busy"))


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()) if count) or "none"


def live_run(name: str, rate_hz: float, seconds: float, folder: Path) -> LiveRun:
    """Play an input at a rate through the processes of `spot3d run --live`; its results go to `folder`."""
    endpoint, frames = free_loopback_endpoint(), max(1, round(rate_hz * seconds))
    command = [sys.executable, "-m", "spot3d", "run", name, "--live", "--rate", f"{rate_hz:g}", "--out", str(folder)]
    command += ["--frames", str(frames), "--listen", endpoint]
    start_s = time.monotonic()
    with subprocess.Popen(
        command, env=os.environ | SINGLE_THREADED, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        try:
            seen, cpu = _watch(process, endpoint, start_s + seconds + _LIMIT_S)
        finally:
            if process.poll() is None:
                process.terminate()
        said = process.communicate()[1].decode(errors="replace").strip()
    result = LiveRun()
    report = folder / "report.json"
    if process.returncode != 0 or not report.exists() or not seen:
        result.error = said.splitlines()[-1] if said else f"ended with exit code {process.returncode}"
        return result
    result.report = json.loads(report.read_text(encoding="utf-8"))
    result.start_s, result.fused = seen[0][0] - start_s, seen[-1][1]
    if len(seen) > 1:
        result.rate_hz = (seen[-1][1] - seen[0][1]) / (seen[-1][0] - seen[0][0])
        result.cores = sum(
            _slope([item for item in readings if seen[0][0] <= item[0] <= seen[-1][0]]) for readings in cpu
        )
    return result


def _watch(
    process: subprocess.Popen[bytes], endpoint: str, deadline_s: float
) -> tuple[list[Reading], list[list[Reading]]]:
    """Monitor the run until its process ends.

    Returns (monotonic seconds, frames fused) of each progress message with another frame fused; and for each stage
    (monotonic seconds, its CPU seconds) of each of its health messages.
    """
    seen: list[Reading] = []
    cpu: dict[str, list[Reading]] = {stage: [] for stage in STAGES}
    robot = load_settings().link.robot
    with ExitStack() as stack:
        while process.poll() is None and time.monotonic() < deadline_s:
            try:
                session = stack.enter_context(zenoh.open(zenoh_config(LinkSettings(connect=(endpoint,)))))
                break
            except zenoh.ZError:  # the run's router is not up yet
                time.sleep(_POLL_S)
        else:
            return seen, []
        progress = session.declare_subscriber(key(robot, "fusion/progress"), FifoChannel(4096))
        health = [session.declare_subscriber(key(robot, f"{stage}/health"), FifoChannel(64)) for stage in STAGES]
        while process.poll() is None and time.monotonic() < deadline_s:
            for subscriber in health:
                for told in arrived(subscriber.handler, Health):
                    cpu[told.stage].append((time.monotonic(), told.cpu_s))
            for said in arrived(progress.handler, Progress):
                if said.fused > (seen[-1][1] if seen else 0):
                    seen.append((time.monotonic(), said.fused))
            time.sleep(_POLL_S)
    return seen, list(cpu.values())


def _slope(readings: Sequence[Reading]) -> float:
    """Increase per second from the first reading to the last."""
    if len(readings) < 2:
        return 0.0
    (start_s, before), (end_s, after) = readings[0], readings[-1]
    return (after - before) / (end_s - start_s)
