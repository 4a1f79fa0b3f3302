"""`spot3d bench`: where the time goes, beside references measured in the same run."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spot3d.cli.options import CommandError, check_outputs, say

if TYPE_CHECKING:
    from spot3d.bench.material import Material
    from spot3d.evaluate.table import Table
    from spot3d.settings import Settings

SECTIONS = ("kernels", "pose", "messages", "live", "growth")
SCENE = "scene"
FRAMES = 60
"""Frames of each data set."""
FEW = 24
"""Frames that kernels run on, back and forth."""


def bench(
    json_file: Annotated[
        Path | None, typer.Option("--json", help="JSON file for the numbers and the conditions of the measurement")
    ] = None,
    plots: Annotated[Path | None, typer.Option(help="folder for plots of the growth")] = None,
    frames: Annotated[
        int, typer.Option(min=2, help="number of frames of a data set, which are held in memory")
    ] = FRAMES,
    data: Annotated[
        list[Path] | None, typer.Option(help="recording with true poses to measure as well; may be repeated")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(help=f"measure this part only: {', '.join(SECTIONS)}; may be repeated")
    ] = None,
    live_seconds: Annotated[float, typer.Option(min=0.1, help="length of the live runs, seconds")] = 20.0,
    rate: Annotated[float, typer.Option(min=0.1, help="frames per second of the live runs")] = 30.0,
    growth: Annotated[int, typer.Option(min=2, help="longest path of the growth measurement, frames")] = 2000,
) -> None:
    """Measure time and memory of every step and process on the built-in scene; print Markdown."""
    from spot3d.dataflow.process_use import stay_single_threaded
    from spot3d.evaluate.record import data_checksum, record
    from spot3d.evaluate.table import to_markdown, write_tables
    from spot3d.machine import machine
    from spot3d.settings import load_settings

    chosen = tuple(only or SECTIONS)
    for name in chosen:
        if name not in SECTIONS:
            raise CommandError(f"there is no measurement {name!r}; choose from {', '.join(SECTIONS)}")
    check_outputs(json_file, plots)
    stay_single_threaded()
    settings = load_settings()
    names = [SCENE, *map(str, data or [])]
    made = []
    for table in _tables(chosen, names, frames, live_seconds, rate, growth, plots, settings):
        made.append(table)
        typer.echo(to_markdown(table))
    on = machine()
    typer.echo(f"On {on['cpu']}, {on['cores']} cores, Python {on['python']}.")
    if json_file is not None:
        options = {"only": only, "frames": frames, "live_seconds": live_seconds, "rate": rate, "growth": growth}
        kept = record(settings, {name: data_checksum(name) for name in names}, options)
        write_tables(json_file, kept, made)


def _tables(
    chosen: tuple[str, ...],
    names: list[str],
    frames: int,
    live_seconds: float,
    rate: float,
    growth: int,
    plots: Path | None,
    settings: "Settings",
) -> Iterator["Table"]:
    """The chosen tables, each as soon as it is measured."""
    materials = _materials(names, frames, settings)
    if "kernels" in chosen:
        from spot3d.bench.kernels import kernels_table

        yield kernels_table([material.first(FEW) for material in materials], settings, say)
    if "pose" in chosen:
        from spot3d.bench.poses import pose_table

        yield pose_table(materials, settings.pose, say)
    if "messages" in chosen:
        from spot3d.bench.messages import messages_table

        yield messages_table(materials, say)
    if "live" in chosen:
        from spot3d.bench.live import live_table

        yield live_table(materials, rate, live_seconds, say)
    if "growth" in chosen:
        from spot3d.bench.growth import charts, map_growth
        from spot3d.drawing.picture import write_picture

        table = map_growth(materials[1], growth, settings, say)
        yield table
        if plots is not None:
            plots.mkdir(parents=True, exist_ok=True)
            for name, picture in charts(table).items():
                write_picture(plots / f"growth-{name}.png", picture)


def _materials(names: list[str], count: int, settings: "Settings") -> list["Material"]:
    """Each data set at full and at half size."""
    from spot3d.bench.material import prepare
    from spot3d.source.halving import halve
    from spot3d.source.sequences import open_source

    made = []
    for name in names:
        say(f"{name}: {count} frames ...")
        frames = list(islice(open_source(name), count))
        made += [prepare(Path(name).name, sized, settings) for sized in (frames, [halve(one) for one in frames])]
    return made
