"""`spot3d evaluate`: the paper's tables on data sets that are there."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from spot3d.cli import options
from spot3d.cli.options import CommandError, check_outputs, say
from spot3d.settings import load_settings
from spot3d.source.errors import SourceError
from spot3d.source.intrinsics_files import parse_intrinsics

ALL, RUN, ROBUSTNESS = "all", "run", "robustness"
BUILT_IN = ("scenes:5",)
"""Measured by `evaluate all` beside the data sets below its root."""


def evaluate(
    table: Annotated[
        str,
        typer.Argument(
            help="proposals, still, moving, steps, filters, objects, ablations, points, time, poses, stability; or: "
            "all, run, robustness"
        ),
    ],
    path: Annotated[
        str,
        typer.Argument(
            metavar="PATH",
            help="folder of a data set, scene:SEED or scenes:5; for all: the folder that contains the data sets",
        ),
    ],
    json_file: Annotated[
        Path | None, typer.Option("--json", help="JSON file for the numbers and the conditions of the measurement")
    ] = None,
    plots: Annotated[Path | None, typer.Option(help="folder for plots of recall over IoU")] = None,
    pose: Annotated[
        Literal["given", "kiss", "gicp"],
        typer.Option(help="source of the poses; given: the data's true ones (kiss where it has none)"),
    ] = "given",
    of: Annotated[Path | None, typer.Option(help="for run: the folder of a finished run of PATH, live or not")] = None,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="KIND,..",
            help="for robustness: poses, delay, mount, centre, focal, scale, bent, depth, edges, holes, colour, every, "
            "together, half; default: all",
        ),
    ] = None,
    every: options.Every = 1,
    frames: options.Frames = None,
    half: options.Half = False,
    intrinsics: options.Intrinsics = None,
    settings: options.Settings = None,
    preset: options.Preset = None,
) -> None:
    """Measure as the paper does: print TABLE in Markdown for the data set at PATH, or all tables for all data.

    The table `run` is of a run that is over, live ones included: spot3d evaluate run PATH --of FOLDER. `robustness` is
    of runs, or of single frames, on input that is made worse, a kind after the other, `moving` of single frames as a
    camera that moves has them; these two are not among `all`, they take long.
    """
    from spot3d.dataflow.process_use import stay_single_threaded
    from spot3d.evaluate.datasets import at_half_size, datasets_below, distinctly_named, open_dataset
    from spot3d.evaluate.finished_run import finished_table
    from spot3d.evaluate.record import data_checksum, record
    from spot3d.evaluate.robustness import GROUPS
    from spot3d.evaluate.table import to_markdown, write_plots, write_tables
    from spot3d.evaluate.tables import SHORT_TABLES, TABLES, make_tables, robustness_tables
    from spot3d.failures import StageFailedError

    if table not in (ALL, RUN, ROBUSTNESS, *TABLES):
        raise CommandError(f"there is no table {table!r}; choose from {', '.join(TABLES)}, run, robustness, and all")
    kinds = GROUPS if only is None else tuple(only.replace(",", " ").split())
    if (only is not None and table != ROBUSTNESS) or not kinds or not set(kinds) <= set(GROUPS):
        raise CommandError(f"--only applies to robustness; choose from {', '.join(GROUPS)}")
    if (table == RUN) != (of is not None):
        raise CommandError("measure a finished run with: spot3d evaluate run PATH --of FOLDER")
    if intrinsics is not None and table == ALL:
        raise CommandError("--intrinsics apply to one data set; name it and one table")
    check_outputs(json_file, plots)
    stay_single_threaded()
    names = [path] if table != ALL else [*BUILT_IN, *map(str, datasets_below(Path(path)))]
    resolved = load_settings(settings, preset, {"pose": {"provider": pose}})
    camera = None if intrinsics is None else parse_intrinsics(intrinsics)
    opened = {}
    for name in names:
        try:
            if table == ROBUSTNESS:
                # All frames of the stretch: pose errors are those between neighbours, whichever frames are then taken.
                dataset = open_dataset(name, resolved, 1, frames and frames * every, camera)
            else:
                dataset = open_dataset(name, resolved, every, frames, camera)
        except SourceError as error:
            if table != ALL:
                raise
            say(f"left out: {error}")
            continue
        opened[name] = at_half_size(dataset) if half else dataset
    datasets = distinctly_named(opened)
    made = []
    try:
        if table == ROBUSTNESS:
            tables = robustness_tables(datasets, resolved, every, kinds, say)
        elif of is not None:
            tables = iter([finished_table(dataset, of, resolved) for dataset in datasets])
        else:
            tables = make_tables(SHORT_TABLES if table == ALL else [table], datasets, resolved, say)
        for one in tables:
            made.append(one)
            typer.echo(to_markdown(one))
    except StageFailedError as error:
        raise CommandError(str(error)) from error
    given = {"table": table, "every": every, "frames": frames, "half": half, "pose": pose, "of": of and str(of)}
    given |= {"intrinsics": intrinsics, "only": only}
    kept = record(resolved, {name: data_checksum(name) for name in names}, given)
    typer.echo(_measured_on(kept))
    if json_file is not None:
        write_tables(json_file, kept, made)
    if plots is not None:
        write_plots(plots, made)


def _measured_on(kept: dict[str, Any]) -> str:
    machine = kept["machine"]
    given = ", ".join(f"{name} {value}" for name, value in kept["options"].items() if value not in (None, False))
    data = "; ".join(f"{name} ({checksum[:12]})" for name, checksum in kept["data"].items())
    return (
        f"spot3d {kept['version']}, preset {kept['settings']['preset']}, on {machine['cpu']}, "
        f"{machine['cores']} cores, Python {machine['python']}. Options: {given}. Data, with checksum: {data}."
    )
