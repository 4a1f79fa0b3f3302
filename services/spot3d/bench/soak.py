"""Soak test: whether anything grows in a long live run.

    python -m spot3d.bench.soak --minutes 60 path/to/recording

plays the frames to and fro at half size through real processes, and reads memory, descriptors, threads and drops of
each. Linux only, as it reads /proc.
"""

import json
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer
from zenoh.handlers import RingChannel

from spot3d.bench.readings import Growth, Reading, charts, growths, minute_table, read_process
from spot3d.bench.recording import write_recording
from spot3d.dataflow.payload import arrived
from spot3d.dataflow.process_use import KEEPING_MEMORY, SINGLE_THREADED
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.drawing.picture import write_picture
from spot3d.settings import without_settings
from spot3d.source.halving import halve
from spot3d.source.process import run as run_source
from spot3d.source.sequence import FrameSequence
from spot3d.source.sequences import open_source
from spot3d.source.settings import SourceSettings
from spot3d_schemas import STAGES, Health, Progress, key

_RATE_HZ = 30.0
_FRAMES = 300
"""0.12 GB at half size of VGA."""
_EVERY_S = 5.0
_ROBOT = "soak"
_END_S = 10.0

log = logging.getLogger("spot3d.soak")


def soak(
    input_name: Annotated[str, typer.Argument(metavar="INPUT", help="a recording's folder, or: scene")] = "scene",
    minutes: Annotated[float, typer.Option(min=0.5, help="duration, minutes")] = 60.0,
    out: Annotated[Path, typer.Option(help="folder for the readings, plots and logs")] = Path("out/soak"),
) -> None:
    """Run live at 30 half-size frames a second and watch the processes; exit code 1 where one dies or grows."""
    logging.basicConfig(format="%(asctime)s %(name)s %(levelname)s: %(message)s", level=logging.INFO)
    out.mkdir(parents=True, exist_ok=True)
    log.info("%s: reading %d frames", input_name, _FRAMES)
    frames = [halve(frame) for frame in islice(open_source(input_name), _FRAMES)]
    with tempfile.TemporaryDirectory(prefix="spot3d-soak-") as name:
        recording = Path(name) / "recording"
        write_recording(recording, frames, round(60 * minutes * _RATE_HZ))
        readings, died = watch(open_source(recording), 60 * minutes, out)
    for name, picture in charts(readings).items():
        write_picture(out / f"{name}.png", picture)
    grown = growths(readings)
    record = {"readings": list(map(asdict, readings)), "growth": list(map(asdict, grown)), "died": died}
    (out / "soak.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    for line in (*minute_table(readings), *map(Growth.line, grown), *died, f"plots and logs are in {out}"):
        typer.echo(line)
    if died or any(item.too_much for item in grown):
        raise typer.Exit(1)


def watch(sequence: FrameSequence, seconds: float, out: Path) -> tuple[list[Reading], list[str]]:
    """Readings of every process while the sequence plays, and a text for each that ended by itself."""
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot=_ROBOT, connect=(endpoint,), delivery="live")
    readings: list[Reading] = []
    with ExitStack() as stack:
        processes = {"router": stack.enter_context(_process(["router", "--listen", endpoint], out, "router"))}
        arguments = ["--robot", _ROBOT, "--connect", endpoint, "--live"]
        for stage in STAGES[1:]:
            processes[stage] = stack.enter_context(_process([stage, *arguments], out, stage))
        session = stack.enter_context(open_session(link))
        healths = [session.declare_subscriber(key(_ROBOT, f"{stage}/health"), RingChannel(1)) for stage in STAGES]
        progress = session.declare_subscriber(key(_ROBOT, "fusion/progress"), RingChannel(1))
        drops, fused = dict[str, int](), 0

        def listen() -> None:
            nonlocal fused
            for ear in healths:
                for health in arrived(ear.handler, Health):
                    drops[health.stage] = sum(health.drops.values())
            for said in arrived(progress.handler, Progress):
                fused = said.fused

        stop = threading.Event()
        source = threading.Thread(
            target=run_source,
            args=(link, SourceSettings(), sequence, _RATE_HZ, stop, STAGES[1:]),
            name="soak source",
            daemon=True,
        )
        stack.callback(source.join, _END_S)
        stack.callback(stop.set)
        source.start()
        while not fused and source.is_alive() and not _ended(processes):
            listen()
            time.sleep(0.1)
        start_s = time.monotonic()
        log.info("the first frame is fused; reading every %.0f s for %.1f minutes", _EVERY_S, seconds / 60)
        next_s = start_s
        while time.monotonic() - start_s < seconds and source.is_alive() and not _ended(processes):
            listen()
            if time.monotonic() >= next_s:
                next_s += _EVERY_S
                at_s = time.monotonic() - start_s
                for name, process in processes.items():
                    use = read_process(process.pid)
                    readings.append(Reading(name, at_s, *use, drops.get(name, 0), fused if name == "fusion" else 0))
            time.sleep(0.2)
        died = [f"{name} ended with {code}; see {out / name}.log" for name, code in _ended(processes).items()]
        if time.monotonic() - start_s < seconds - _END_S and not died:
            died.append("the source has ended too early; see above")
    return readings, died


def _ended(processes: Mapping[str, subprocess.Popen[bytes]]) -> dict[str, int]:
    codes = {name: process.poll() for name, process in processes.items()}
    return {name: code for name, code in codes.items() if code is not None}


@contextmanager
def _process(arguments: list[str], out: Path, name: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run `spot3d ARGUMENTS` until the block is left; its log, and snapshots of the map, go to `out`."""
    snapshots = {"SPOT3D_LINK__SNAPSHOT_FOLDER": str((out / "snapshots").absolute())}
    environment = without_settings(os.environ) | SINGLE_THREADED | KEEPING_MEMORY | snapshots
    with (
        (out / f"{name}.log").open("wb") as stream,
        subprocess.Popen(
            [sys.executable, "-m", "spot3d", *arguments], stdout=stream, stderr=subprocess.STDOUT, env=environment
        ) as process,
    ):
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()


if __name__ == "__main__":
    typer.run(soak)
