"""The command line. Heavy modules are imported by the command that needs them."""

import json
import sys
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from spot3d import missing_package
from spot3d.cli import options, recordings, stages
from spot3d.cli.bench import bench
from spot3d.cli.certificates import certificates
from spot3d.cli.dashboard import dashboard, dashboard_if_wanted, own_command
from spot3d.cli.doctor import doctor
from spot3d.cli.evaluate import evaluate
from spot3d.cli.options import CommandError, check_topics, link_overrides, out_folder, play_overrides, stage_started
from spot3d.dataflow.settings import USUAL_ENDPOINT
from spot3d.dataflow.stopping import end_with_any_thread
from spot3d.file_errors import in_words
from spot3d.settings import InvalidSettingsError, Settings, load_settings, to_toml
from spot3d.source.errors import SourceError

if TYPE_CHECKING:
    from spot3d.run.run import Finished

app = typer.Typer(
    help="Finds the objects in front of an RGB-D camera: 3D boxes around unknown objects, without training.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _command in (*stages.COMMANDS, *recordings.COMMANDS, certificates, dashboard, doctor, evaluate, bench):
    app.command()(_command)


def main() -> None:
    """Run the command line; errors that the user can correct are printed in one line, with exit code 2."""
    end_with_any_thread()
    for stream in (sys.stdout, sys.stderr):
        # A path may contain characters that a terminal cannot show.
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        app()
    except ModuleNotFoundError as error:
        _fail(missing_package.in_words(error))
    except (SourceError, InvalidSettingsError, CommandError) as error:
        _fail(str(error))
    except OSError as error:
        _fail(in_words(error))


@app.callback()
def before_any_command(version: options.Version = False) -> None:
    """Takes the options of the command line as a whole."""


@app.command()
def run(
    input_name: options.Input,
    out: Annotated[Path | None, typer.Option(help="folder for the results; default: out/ and INPUT's name")] = None,
    pose: Annotated[
        str | None,
        typer.Option(
            metavar="kiss|gicp|truth|TOPIC",
            help="source of the camera poses: kiss, gicp, truth or a topic; default: kiss",
        ),
    ] = None,
    settings: options.Settings = None,
    preset: options.Preset = None,
    in_process: options.InProcess = False,
    half: options.Half = False,
    frames: options.Frames = None,
    every: options.Every = 1,
    live: Annotated[bool, typer.Option("--live", help="play at the recorded rate, and drop frames when busy")] = False,
    rate: options.Rate = None,
    intrinsics: options.Intrinsics = None,
    noise: options.Noise = None,
    depth_unit: options.DepthUnit = None,
    colour_topic: options.ColourTopic = None,
    depth_topic: options.DepthTopic = None,
    listen: options.Listen = None,
    show: options.Dashboard = False,
) -> None:
    """Play INPUT through all stages and write the objects found, with a picture, into a folder."""
    from spot3d.source.sequences import has_topics, is_stream

    if pose is not None and "/" not in pose and pose not in ("kiss", "gicp", "truth", "given"):
        raise CommandError(
            f"--pose {pose}: choose kiss or gicp (odometry), truth (the input's own poses), or a topic with a / in its "
            "name: of a ROS bag, such as /odom or /tf, or a key of Zenoh, such as ROBOT/odom"
        )
    topic = pose if pose is not None and "/" in pose else None
    in_bag = None
    check_topics(input_name, colour_topic=colour_topic, depth_topic=depth_topic)
    if topic is not None and has_topics(input_name):
        pose, topic, in_bag = "truth", None, topic
    if topic is not None:
        _check_key(topic)
    if in_process and topic is not None:
        raise CommandError(f"--in-process cannot receive topics; omit --in-process, or --pose {pose}")
    overrides = play_overrides(
        halved=half or None,
        rate_hz=rate,
        depth_noise=noise,
        depth_unit=depth_unit,
        colour_topic=colour_topic,
        depth_topic=depth_topic,
        pose_topic=in_bag,
    )
    camera = is_stream(input_name)
    if camera and in_process:
        raise CommandError(f"--in-process plays only recordings; omit it for {input_name}, which plays live")
    overrides["link"] = {"delivery": "live" if live or camera else "lossless"}
    if pose is not None and topic is None:
        overrides["pose"] = {"provider": "given" if pose == "truth" else pose}
    resolved = load_settings(settings, preset, overrides)
    if listen:
        # Checked as settings are, so that a typo is reported as one.
        load_settings(settings, preset, {"link": {"mode": "router", "listen": tuple(listen)}})
    from spot3d.run.display import RunConsole
    from spot3d.run.run import run as run_input
    from spot3d.source.selected import selection

    chosen, folder = selection(input_name, frames, every, intrinsics), out_folder(input_name, out)
    console = RunConsole()
    with dashboard_if_wanted(show, in_process, resolved, settings, folder, console) as page:
        endpoints = (*(listen or ()), *(() if page is None else (page.endpoint,)))
        usual = None if listen else USUAL_ENDPOINT
        show_it = None if page is None else page.start
        done = run_input(chosen, resolved, folder, console, in_process, topic, endpoints, usual, show_it)
        _conclude(done, resolved, topic is not None or resolved.pose.provider == "given")
        if page is not None:
            page.keep()


@app.command()
def demo(
    frames: Annotated[int, typer.Option(min=1, help="length of the scene in frames, at 30 Hz")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="seed of the scene")] = 0,
    out: Annotated[Path, typer.Option(help="folder for the results")] = Path("out/demo"),
    settings: options.Settings = None,
    preset: options.Preset = None,
    in_process: options.InProcess = False,
    half: options.Half = False,
    show: options.Dashboard = False,
) -> None:
    """Find the objects of the built-in scene, with KISS-ICP's poses, and compare them with what is there."""
    from spot3d.run.demo import demo_table, match_objects
    from spot3d.run.display import RunConsole
    from spot3d.run.run import run as run_input
    from spot3d.source.scene.model import build_scene
    from spot3d.source.selected import selection

    overrides = play_overrides(halved=half or None) | {"link": {"delivery": "lossless"}, "pose": {"provider": "kiss"}}
    resolved = load_settings(settings, preset, overrides)
    console = RunConsole()
    with dashboard_if_wanted(show, in_process, resolved, settings, out, console) as page:
        endpoints = () if page is None else (page.endpoint,)
        chosen = selection(f"scene:{seed}", frames, 1, None)
        show_it = None if page is None else page.start
        done = run_input(chosen, resolved, out, console, in_process, None, endpoints, USUAL_ENDPOINT, show_it)
        true = [(box.name, box) for box in build_scene(seed).boxes]
        console.print(demo_table(*match_objects(true, done.result.objects)))
        _conclude(done, resolved, False)
        if page is None:
            typer.echo(f"to see it live in the browser: {own_command()} demo --dashboard")
        else:
            page.keep()


@app.command()
def topics(robot: options.Robot = None) -> None:
    """Print every topic: its key, message, rate and delivery."""
    from spot3d_schemas import TOPICS

    if robot is not None:
        # Checked as settings are, so that a typo is reported as one.
        load_settings(overrides=link_overrides(robot))
    rows = [("key", "message", "rate", "delivery")]
    for topic in TOPICS.values():
        where = topic.key_template.format(robot=robot or "<robot>")
        rate = f"{topic.rate_hz:g} Hz" if topic.kind == "pub" else "query"
        rows.append((where, topic.message.__name__, rate, topic.delivery))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    for row in rows:
        typer.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


@app.command()
def schema(name: Annotated[str, typer.Argument(help="name of a message, such as Frame")]) -> None:
    """Print the JSON Schema of a message, for clients in other languages."""
    from spot3d_schemas import MESSAGES, json_schema

    message = MESSAGES.get(name.removeprefix("spot3d."))
    if message is None:
        raise CommandError(f"there is no message {name!r}; choose from {', '.join(MESSAGES)}")
    typer.echo(json.dumps(json_schema(message), indent=2))


@app.command()
def status(
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    watch: Annotated[bool, typer.Option("--watch", help="update the table until Ctrl-C")] = False,
) -> None:
    """Print the live health of every stage; exit code 1 if something is wrong, as that one is not alive."""
    from rich.console import Console

    from spot3d.run.status import show_status

    resolved = load_settings(settings, None, link_overrides(robot, connect))
    if not show_status(resolved.link, Console(), watch):
        raise typer.Exit(1)


@app.command()
def results(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="folder in which each stream of frames gets a folder")],
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    keep: Annotated[int, typer.Option(min=1, help="number of streams that are kept; older ones are deleted")] = 100,
    supervised: options.Supervised = False,
) -> None:
    """Keep what the robot's stages find, in a folder for each stream of frames, until Ctrl-C."""
    stop = stage_started(supervised)
    resolved = load_settings(settings, None, link_overrides(robot, connect))
    from spot3d.run.keep_results import keep_results

    keep_results(resolved.link, out, keep, stop)


@app.command(name="settings")
def print_settings(settings: options.Settings = None, preset: options.Preset = None) -> None:
    """Print all settings as they would be used, as a TOML file with descriptions."""
    typer.echo(to_toml(load_settings(settings, preset)), nl=False)


def _conclude(done: "Finished", settings: Settings, given_poses: bool) -> None:
    """Print how a run went, and end with the exit code for programs. given_poses: they are no odometry's."""
    from spot3d.pose import delay, depth_scale, orientation
    from spot3d.pose.estimate import GIVEN_JUMPED
    from spot3d.run.earlier_streams import FOLDER as EARLIER
    from spot3d.run.left_out import first_depth, forgotten, pose_doubt, why_so_few
    from spot3d.run.lost_tracking import notice

    report, result = done.report, done.result
    found = len(result.objects)
    typer.echo(
        f"{found} object{'s' * (found != 1)} from {report.fused} of {report.played} frames in {report.wall_s:.1f} s"
        f" ({report.not_fused()}); results in {done.folder}"
    )
    few = why_so_few(result, report.keyframes, settings)
    jumps = report.stages["pose"].events.get(GIVEN_JUMPED, 0) if "pose" in report.stages else 0
    doubt = pose_doubt(result, report.fused, report.skipped, jumps) if given_poses else ""
    seen = first_depth(done.sequence, bool(found)) if report.fused else ""
    known = result.calibration()
    corrected = depth_scale.notice(known.depth_factor), delay.notice(result.delay_s()), orientation.notice(known)
    anew = (
        f"the camera's stream restarted: earlier results are in {done.folder / EARLIER}"
        if report.earlier_streams
        else ""
    )
    lost, unkept = notice(report.lost, given_poses), forgotten(result.keyframes_dropped, settings)
    for line in (anew, few, doubt, seen, lost, *corrected, unkept):
        if line:
            typer.echo(line)
    typer.echo(f"picture: {done.folder / 'overview.png'}")
    if report.error:
        _fail(report.error, code=1)
    if report.interrupted:
        raise typer.Exit(130)


def _check_key(topic: str) -> None:
    """Refuse a topic that is no key of Zenoh."""
    import zenoh

    from spot3d.dataflow.session import first_line

    try:
        zenoh.KeyExpr(topic)
    except zenoh.ZError as error:
        raise CommandError(
            f"--pose {topic} is not a key of poses; give one such as ROBOT/odom: {first_line(error)}"
        ) from error


def _fail(message: str, code: int = 2) -> NoReturn:
    typer.echo(f"error: {message}", err=True)
    sys.exit(code)
