"""Texts of the panel, as HTML and Markdown."""

from collections.abc import Mapping, Sequence
from html import escape

from spot3d.dashboard.health import HEARD, Word
from spot3d.dashboard.robot import Robot

_COLOURS = {"good": "#40c057", "waits": "#fab005", "bad": "#fa5252", "ended": "#868e96"}
_REASONS_MOST = 12


def waiting_for(router: bool, where: str, robots: Sequence[str], robot: Robot | None, frames_s: float | None) -> str:
    """What is missing before there is something to show, and what to do; empty where nothing is missing.

    frames_s: how long ago the last frame of the robot shown came, None: none has come.
    """
    if robot is not None and robot.complete and not robot.alive:
        ended = f"The run of **{robot.name}** is complete, and its stages have ended. Its results stay here."
        return ended if router else f"{ended} Its router has ended too: none answers at `{where}`."
    if not router:
        return (
            f"Waiting for a router: none answers at `{where}`. Start `spot3d run`, `spot3d router` or `zenohd` "
            "there, or give its address with `--connect`."
        )
    if not robots or robot is None:
        return f"Waiting for a robot: no robot is connected to the router at `{where}`. Start its stages."
    if not robot.alive:
        return f"**{robot.name}** is gone: none of its stages is running. The last state received is shown."
    if frames_s is None:
        progress = robot.progress
        came = 0 if progress is None else progress.fused + sum(progress.skipped.values())
        if came and robot.records.latest("source") is None:
            return (
                f"No image of **{robot.name}**: the program that sends its frames does not publish `source/preview`. "
                "Boxes and map are shown anyway."
            )
        if "source" not in robot.alive:
            return f"Waiting for a frame of **{robot.name}**: no source is running. Start one with `spot3d source`."
        return f"Waiting for the first frame of **{robot.name}**."
    return ""


def summary(robot: Robot) -> str:
    """One line on a robot's objects, frames and map."""
    objects, progress = robot.objects, robot.progress
    fused = 0 if progress is None else progress.fused
    frames = fused if objects is None else max(fused, objects.frame_count)
    found = 0 if objects is None else len(objects.objects)
    text = f"**{robot.name}**: {found} object{'s' * (found != 1)} in {frames} frames"
    if robot.map.total:
        text += f", {robot.map.total / 1000:.0f} k points"
    if robot.map.behind:
        text += f" ({robot.map.behind / 1000:.0f} k more are being fetched)"
    if robot.map.left_out:
        text += f" (only {robot.map.limit} of them are shown; see dashboard.points_max)"
    if robot.complete:
        text += ", complete"
    return text


def health_table(words: Sequence[Word]) -> str:
    """Status of each stage and of the bridge."""
    rows = "".join(
        f'<tr><td style="color:{_COLOURS[word.level]}">&#9679;</td><td><b>{escape(word.stage)}</b></td>'
        f"<td>{escape(word.text)}</td></tr>"
        for word in words
    )
    return _table(rows)


def hop_table(times: Mapping[str, Mapping[str, float]]) -> str:
    """Latency of each hop, milliseconds."""
    if not times:
        return "no frame has passed through yet"
    rows = "".join(
        f"<tr><td>{escape(name)}</td>{_number(said['p50'])}{_number(said['p99'])}</tr>" for name, said in times.items()
    )
    return _table(f"<tr><td><i>ms</i></td>{_right('<i>p50</i>')}{_right('<i>p99</i>')}</tr>{rows}")


def drop_table(drops: Mapping[str, Mapping[str, int]]) -> str:
    """Drops so far, by stage and reason."""
    counted = [(count, stage, reason) for stage in HEARD for reason, count in drops.get(stage, {}).items()]
    if not counted:
        return "none dropped"
    counted.sort(reverse=True)
    rows = "".join(
        f"<tr><td><b>{escape(stage)}</b></td><td>{escape(reason)}</td>{_right(str(count))}</tr>"
        for count, stage, reason in counted[:_REASONS_MOST]
    )
    return _table(rows)


def _number(value: float) -> str:
    return _right(f"{value:.1f}")


def _right(text: str) -> str:
    return f'<td style="text-align:right;white-space:nowrap">{text}</td>'


def _table(rows: str) -> str:
    style = "font-size:0.8em;line-height:1.35;border-spacing:0.5em 0.1em;width:100%;padding:0 0.5em"
    return f'<table style="{style}">{rows}</table>'
