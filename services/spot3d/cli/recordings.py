"""The commands that record what is on the wire, play it again, and export it to other viewers."""

import logging
import sys
from pathlib import Path
from typing import Annotated

import typer

from spot3d.cli import options
from spot3d.cli.options import CommandError, link_overrides, say, stage_started
from spot3d.settings import load_settings

TopicsOption = Annotated[
    list[str] | None, typer.Option(help="record only these topics, such as source/*; may be repeated; default: all")
]
RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING.mcap", help="file of spot3d record")]


def record(
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="file to write")],
    topics: TopicsOption = None,
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    listen: options.Listen = None,
    lossless: options.Lossless = None,
    supervised: options.Supervised = False,
) -> None:
    """Record what is on the wire into an MCAP file, until Ctrl-C; exit code 1 if the disk is full before."""
    stop = stage_started(supervised)
    resolved = load_settings(settings, None, link_overrides(robot, connect, listen, lossless))
    from spot3d.recorder.record import NoSuchTopicError, matching_topics, published_topics
    from spot3d.recorder.record import record as record_topics

    try:
        chosen = matching_topics(topics or (), published_topics())
        recorded = record_topics(resolved, out, chosen, stop)
    except NoSuchTopicError as error:
        raise CommandError(str(error)) from error
    except FileExistsError as error:
        raise CommandError(f"{out} already exists; give another name, or delete it") from error
    typer.echo(recorded.summary())
    if recorded.error:
        raise typer.Exit(1)


def play(
    recording: RecordingArgument,
    topics: TopicsOption = None,
    rate: Annotated[
        float, typer.Option(min=0.01, max=100, help="speed relative to the recording: 2 is twice as fast")
    ] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="play repeatedly until Ctrl-C")] = False,
    start: Annotated[float, typer.Option("--from", min=0, help="where to start, seconds from the beginning")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", min=0, help="where to end, seconds from the beginning")] = None,
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    listen: options.Listen = None,
    lossless: options.Lossless = None,
) -> None:
    """Put a recording back on the wire, in its own time; the space bar pauses it."""
    logging.basicConfig(format="%(asctime)s %(name)s %(levelname)s: %(message)s", level=logging.INFO)
    from spot3d.recorder.mcap_contents import open_mcap
    from spot3d.recorder.play import Playing, StageAliveError
    from spot3d.recorder.play import play as play_recording
    from spot3d.recorder.record import NoSuchTopicError, matching_topics

    try:
        contents = open_mcap(recording)
        if not contents.chunks:
            raise CommandError(f"nothing to play: {recording} holds no messages")
        chosen = matching_topics(topics or (), list(contents.topics))
        resolved = load_settings(settings, None, link_overrides(robot or contents.robot, connect, listen, lossless))
        length_s = 1e-9 * (contents.end_ns - contents.start_ns)
        if start >= (length_s if end is None else min(end, length_s)):
            until = "" if end is None else f" and --to {end:g} s"
            raise CommandError(
                f"nothing to play: {recording} is {length_s:.1f} s long, but --from is {start:g} s{until}"
            )
        state = "" if contents.complete else f" (incomplete; its last {contents.lost_bytes} bytes are lost)"
        pause = "; space pauses" if sys.stdin.isatty() else ""
        typer.echo(f"{recording}: {length_s:.1f} s, {len(chosen)} topics{state}, as robot {resolved.link.robot}{pause}")
        sent = play_recording(contents, Playing(chosen, rate, loop, start, end), resolved.link)
    except (StageAliveError, NoSuchTopicError) as error:
        raise CommandError(str(error)) from error
    typer.echo(f"{sent} messages sent")


def export(
    source: Annotated[Path, typer.Argument(metavar="RUN|RECORDING.mcap", help="results of spot3d run, or a recording")],
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="file to write")],
) -> None:
    """Write a run or a recording in Foxglove's schemas, for Foxglove, Lichtblick and Rerun."""
    from spot3d.recorder.foxglove_export import export as export_all

    if not source.exists():
        raise CommandError(f"{source} does not exist; give a folder of results of spot3d run, or a recording")
    if out.suffix.lower() != ".mcap":
        raise CommandError(
            f"{out} would be an MCAP file; give a name that ends in .mcap (the folder of a run has its boxes in "
            "objects.json and its map in heatmap.ply)"
        )
    try:
        written = export_all(source, out, say)
    except FileExistsError as error:
        raise CommandError(f"{out} already exists; give another name, or delete it") from error
    typer.echo(f"{out}: {', '.join(f'{count} {topic}' for topic, count in written.items())}")


COMMANDS = (record, play, export)
