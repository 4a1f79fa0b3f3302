"""Options that several commands share, as types of their parameters, and what they mean for the settings."""

import errno
import logging
import os
import threading
from pathlib import Path
from typing import Annotated, Any

import typer

from spot3d import __version__, settings
from spot3d.dataflow.stopping import stop_with_parent

Input = Annotated[
    str,
    typer.Argument(
        metavar="INPUT",
        help="folder (7-Scenes, TUM RGB-D), ROS bag, file of spot3d record, or: realsense[:SERIAL], scene[:SEED]",
    ),
]
Settings = Annotated[Path | None, typer.Option("--settings", help="TOML file; see: spot3d settings")]
Preset = Annotated[settings.Preset | None, typer.Option(help="values of settings that are not given")]
Robot = Annotated[str | None, typer.Option(help="the robot's name, the first part of every key")]
Connect = Annotated[
    list[str] | None, typer.Option(help="router to connect to, such as tcp/127.0.0.1:7447; may be repeated")
]
Listen = Annotated[
    list[str] | None, typer.Option(help="endpoint to listen on, as the router of other programs; may be repeated")
]
Lossless = Annotated[
    bool | None,
    typer.Option("--lossless/--live", help="lossless: nothing is dropped; live: the latest frame wins"),
]
Frames = Annotated[int | None, typer.Option(min=1, help="number of frames to play at most")]
Every = Annotated[int, typer.Option(min=1, help="play only every nth frame")]
Half = Annotated[bool, typer.Option("--half", help="play frames at half their width and height")]
Intrinsics = Annotated[
    str | None, typer.Option(metavar="FX,FY,CX,CY", help="depth camera's intrinsics, pixels, for any input folder")
]
Rate = Annotated[float | None, typer.Option(min=0.01, help="frames per second to play at; default: as recorded")]
Noise = Annotated[
    str | None,
    typer.Option("--noise", metavar="d435|tof|...", help="noise model of the depth; see: spot3d settings"),
]
DepthUnit = Annotated[
    float | None,
    typer.Option(
        "--depth-unit", metavar="METRES", help="unit of the depth in metres, for any input folder, such as 0.001"
    ),
]
ColourTopic = Annotated[str | None, typer.Option("--colour-topic", help="ROS bags: topic of the colour images")]
DepthTopic = Annotated[str | None, typer.Option("--depth-topic", help="ROS bags: topic of the depth images")]
InProcess = Annotated[bool, typer.Option("--in-process", help="run all stages in one process, without Zenoh")]
Dashboard = Annotated[
    bool, typer.Option("--dashboard", help="show the run live in the browser, and stay there until Ctrl-C")
]
Supervised = Annotated[bool, typer.Option("--supervised", hidden=True)]


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"spot3d {__version__}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and exit")
]


class CommandError(Exception):
    """A command cannot do what it was asked to; the message says why."""


def play_overrides(**named: str | float | None) -> dict[str, Any]:
    """Settings of the source by their names, of the options that were given; None: not given."""
    return {"source": {name: value for name, value in named.items() if value is not None}}


def check_topics(input_name: str, **options: str | None) -> None:
    """Refuse topics for an input that is no ROS bag.

    options: topics by option, `_` for `-`; None: not given.
    """
    from spot3d.source.sequences import has_topics

    given = [f"--{name.replace('_', '-')}" for name, topic in options.items() if topic is not None]
    if given and not has_topics(input_name):
        raise CommandError(f"{input_name} is not a ROS bag: omit {' and '.join(given)}")


def link_overrides(
    robot: str | None, connect: list[str] | None = None, listen: list[str] | None = None, lossless: bool | None = None
) -> dict[str, Any]:
    """Settings of the options that say how a stage reaches the others; only those that were given.

    A stage that listens is the router of the stages that connect to it, and needs no other.
    """
    link: dict[str, Any] = {}
    if robot is not None:
        link["robot"] = robot
    if listen:
        link |= {"mode": "router", "listen": tuple(listen), "connect": ()}
    if connect:
        link["connect"] = tuple(connect)
    if lossless is not None:
        link["delivery"] = "lossless" if lossless else "live"
    return {"link": link}


def out_folder(input_name: str, given: Path | None = None) -> Path:
    """Folder for the results of an input: `given`, or below out/, under the input's name without suffix or colons.

    Raises CommandError where that is the input itself, or a folder of images inside it.
    """
    from spot3d.source.realsense.camera import is_camera
    from spot3d.source.scene.name import parse_scene_name

    place = Path(input_name)
    if place.name in ("", ".."):
        place = place.resolve()
    name = place.stem if place.is_file() else place.name
    folder = given or Path("out") / (name.replace(":", "-") or "run")
    if is_camera(input_name) or parse_scene_name(input_name) is not None:
        return folder
    of_input, of_results = place.resolve(), folder.resolve()
    if of_results == of_input:
        raise CommandError(f"{folder} is the input itself; choose another folder for the results with --out")
    if of_input in of_results.parents and any(_is_image(path) for path in of_results.glob("*")):
        raise CommandError(f"{folder} holds images of the input; choose another folder for the results with --out")
    return folder


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in (".png", ".jpg", ".jpeg") and path.name != "overview.png"


def check_outputs(json_file: Path | None, plots: Path | None) -> None:
    """Make the folders for what a command writes when its work is done.

    Raises OSError, before that work, where a file or a folder of pictures could not be written.
    """
    if json_file is not None and json_file.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(json_file))
    folders = [folder for folder in (json_file and json_file.parent, plots) if folder is not None]
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    for place in (*folders, *([json_file] if json_file is not None and json_file.exists() else [])):
        if not os.access(place, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))


def say(message: str) -> None:
    """Print how the work goes to standard error, so that standard output can be piped."""
    typer.echo(message, err=True)


def stage_started(supervised: bool) -> threading.Event:
    """Set up a stage's process: its log on standard error; returns the event that ends it."""
    logging.basicConfig(format="%(asctime)s %(name)s %(levelname)s: %(message)s", level=logging.INFO)
    stop = threading.Event()
    if supervised:
        stop_with_parent(stop)
    return stop
