"""The commands of the dataflow's processes: each stage, the bridge and the router, on whatever device."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from spot3d.cli import options
from spot3d.cli.options import CommandError, check_topics, link_overrides, play_overrides, stage_started
from spot3d.dataflow.settings import USUAL_ENDPOINT
from spot3d.settings import load_settings

_NEWCOMERS_S = 0.5
"""Interval at which the router looks for new connections."""


def source(
    input_name: options.Input,
    settings: options.Settings = None,
    preset: options.Preset = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    listen: options.Listen = None,
    lossless: options.Lossless = None,
    frames: options.Frames = None,
    every: options.Every = 1,
    half: options.Half = False,
    rate: options.Rate = None,
    intrinsics: options.Intrinsics = None,
    noise: options.Noise = None,
    depth_unit: options.DepthUnit = None,
    colour_topic: options.ColourTopic = None,
    depth_topic: options.DepthTopic = None,
    pose_topic: Annotated[
        str | None, typer.Option("--pose-topic", help="ROS bags: topic of the camera's poses")
    ] = None,
    pose_from_elsewhere: Annotated[bool, typer.Option("--no-pose-stage", help="do not wait for a pose stage")] = False,
    after_ns: Annotated[int | None, typer.Option(hidden=True)] = None,
    sent: Annotated[int, typer.Option(hidden=True)] = 0,
    stream: Annotated[str | None, typer.Option(hidden=True)] = None,
    supervised: options.Supervised = False,
) -> None:
    """The source stage: play INPUT to the other stages."""
    check_topics(input_name, colour_topic=colour_topic, depth_topic=depth_topic, pose_topic=pose_topic)
    stop = stage_started(supervised)
    overrides = play_overrides(
        halved=half or None,
        rate_hz=rate,
        depth_noise=noise,
        depth_unit=depth_unit,
        colour_topic=colour_topic,
        depth_topic=depth_topic,
        pose_topic=pose_topic,
    ) | link_overrides(robot, connect, listen, lossless)
    resolved = load_settings(settings, preset, overrides)
    from spot3d.source.player import Sent
    from spot3d.source.process import MissingStagesError
    from spot3d.source.process import run as run_source
    from spot3d.source.selected import open_selected_stream, open_selection, selection
    from spot3d.source.sequences import is_stream

    chosen = selection(input_name, frames, every, intrinsics, after_ns)
    opened = open_selected_stream if is_stream(input_name) else open_selection
    sequence = opened(chosen, resolved.source)
    awaited = _awaited(input_name, resolved.link.delivery == "live", supervised)
    wait_for = tuple(stage for stage in awaited if stage != "pose" or not pose_from_elsewhere)
    earlier = Sent(sent, after_ns or 0)
    try:
        run_source(
            resolved.link, resolved.source, sequence, stop=stop, wait_for=wait_for, stream=stream, earlier=earlier
        )
    except MissingStagesError as error:
        raise CommandError(str(error)) from error


def _awaited(input_name: str, live: bool, supervised: bool) -> tuple[str, ...]:
    """The stages that must be alive before a source's first frame.

    A recording waits for all of them, because what is played before they listen is lost: it may be over while the
    segments stage still compiles its kernels. A camera goes on, and waits for none, unless a run has started it
    together with the others; then its frames can be fused while that stage compiles.
    """
    from spot3d.source.process import EVERY_STAGE, FUSING_STAGES
    from spot3d.source.realsense.camera import is_camera

    if live and is_camera(input_name):
        return FUSING_STAGES if supervised else ()
    return EVERY_STAGE


def linked(stage: str, does: str) -> Callable[..., None]:
    """The command of a stage that has no options but those of every stage. does: what the stage is for, in words."""

    def command(
        settings: options.Settings = None,
        preset: options.Preset = None,
        robot: options.Robot = None,
        connect: options.Connect = None,
        listen: options.Listen = None,
        lossless: options.Lossless = None,
        supervised: options.Supervised = False,
    ) -> None:
        stop = stage_started(supervised)
        resolved = load_settings(settings, preset, link_overrides(robot, connect, listen, lossless))
        import_module(f"spot3d.{stage}.process").run(resolved.link, getattr(resolved, stage), stop)

    command.__name__, command.__doc__ = stage, f"The {stage} stage: {does}."
    return command


def fusion(
    settings: options.Settings = None,
    preset: options.Preset = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    listen: options.Listen = None,
    lossless: options.Lossless = None,
    resume: Annotated[
        Path | None, typer.Option(help="resume from the map in this snapshot; the poses must be in the same world")
    ] = None,
    supervised: options.Supervised = False,
) -> None:
    """The fusion stage: frames with heat and pose become a map, and the objects in it."""
    stop = stage_started(supervised)
    resolved = load_settings(settings, preset, link_overrides(robot, connect, listen, lossless))
    from spot3d.dataflow.snapshot_file import SnapshotError
    from spot3d.fusion.process import run

    try:
        # A supervisor has the results, and does not wait for a snapshot.
        run(resolved.link, resolved.fusion, stop, resume, keep_last=not supervised)
    except SnapshotError as error:
        raise CommandError(str(error)) from error


def bridge(
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    ground: Annotated[
        list[str] | None, typer.Option(help="router on the other side, such as tcp/ADDRESS:7447; may be repeated")
    ] = None,
    supervised: options.Supervised = False,
) -> None:
    """Join this device's router with another one's over a thin or broken link, which never stalls this device."""
    stop = stage_started(supervised)
    overrides = link_overrides(robot, connect)
    if ground:
        overrides["bridge"] = {"ground": tuple(ground)}
    resolved = load_settings(settings, None, overrides)
    from spot3d.bridge.process import run

    run(resolved.link, resolved.bridge, stop)


def router(
    settings: options.Settings = None,
    listen: Annotated[list[str] | None, typer.Option(help="endpoints to listen on; may be repeated")] = None,
    connect: Annotated[list[str] | None, typer.Option(help="other routers to connect to; may be repeated")] = None,
    stages: Annotated[
        Path | None,
        typer.Option(help="Unix socket for the stages, so that they do not wait for clients connected elsewhere"),
    ] = None,
    supervised: options.Supervised = False,
) -> None:
    """A router that the stages meet at, where no zenohd runs; ends with Ctrl-C.

    Its certificate is that of the settings' [link], and who may do what is what their [access] says.
    """
    stop = stage_started(supervised)
    endpoints, others = tuple(listen or [USUAL_ENDPOINT]), tuple(connect or ())
    if stages is not None:
        stages.parent.mkdir(parents=True, exist_ok=True)
        endpoints = (f"unixsock-stream/{stages.absolute()}", *endpoints)
    # Checked as settings are, so that a typo is reported as one.
    resolved = load_settings(settings, overrides={"link": {"mode": "router", "listen": endpoints, "connect": others}})
    from spot3d.dataflow.heartbeat import Heartbeat
    from spot3d.dataflow.lingering import disable_linger
    from spot3d.dataflow.router import open_router
    from spot3d.dataflow.stopping import stop_on_signals
    from spot3d.security.access import access_control

    access = access_control(resolved.access) if resolved.access.enabled else None
    heartbeat = Heartbeat(resolved.link.heartbeat)
    with (
        stop_on_signals(stop) as stopped,
        open_router(endpoints, others, resolved.link, access, spare=stages is not None),
    ):
        if stages is not None:
            stages.chmod(0o666)  # its folder restricts access: stages may run as other users
        typer.echo(f"router listens at {', '.join(endpoints)}")
        while not stopped.wait(_NEWCOMERS_S):
            disable_linger()
            heartbeat.beat()
        heartbeat.close()


COMMANDS = (
    source,
    linked("pose", "the camera's pose for each frame"),
    linked("proposals", "generic 2D boxes of each frame"),
    linked("heatmap", "how likely each pixel shows an object"),
    linked("segments", "the objects of single keyframes"),
    fusion,
    bridge,
    router,
)
