"""Table of live runs of the real processes over Zenoh."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from spot3d.bench.live_run import LiveRun, live_run
from spot3d.bench.material import Material
from spot3d.bench.recording import write_recording
from spot3d.evaluate.table import Cell, Column, Table, columns

COLUMNS = (
    *(*columns("data", "size"), *columns("offered /s", "fused /s", digits=1)),
    *(*columns("frames", "fused"), *columns("p50 ms", "p99 ms", digits=0), Column("first fused s", 1)),
    *(Column("CPU cores", 2), Column("fusion MB", 0), *columns("not fused", "busy")),
)
_WHOLE = "source to fused"


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
