"""`spot3d doctor`: looks at this device, the router, and every stage that answers."""

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from spot3d.cli import options
from spot3d.cli.options import link_overrides
from spot3d.doctor.finding import Finding
from spot3d.doctor.others import TopicRate
from spot3d.settings import load_settings

_STYLES = {"ok": "green", "note": "yellow", "problem": "bold red"}


def doctor(
    settings: options.Settings = None,
    robot: options.Robot = None,
    connect: options.Connect = None,
    seconds: Annotated[float, typer.Option(min=1.5, help="time over which rates are measured, seconds")] = 3.5,
) -> None:
    """Look at versions, clocks, certificates, kernels, memory and rates on every device; exit code 1 for a problem."""
    from spot3d.doctor.examine import examine

    link = load_settings(settings, None, link_overrides(robot, connect)).link
    findings, sent = examine(link, seconds)
    console = Console()
    show(console, findings, sent)
    problems = sum(finding.level == "problem" for finding in findings)
    console.print(Text(f"{problems or 'no'} problem{'' if problems == 1 else 's'}", style="bold"))
    if problems:
        raise typer.Exit(1)


def show(console: Console, findings: Sequence[Finding], sent: Sequence[TopicRate]) -> None:
    """Print each finding in one line with its remedy below, and how much is sent by topic."""
    for finding in findings:
        line = Text(f"{finding.level:8}", style=_STYLES[finding.level])
        line.append(f"{finding.what}: {finding.text}", style="default")
        console.print(line, soft_wrap=True)
        if finding.remedy:
            console.print(Text(f"        -> {finding.remedy}"), soft_wrap=True)
    if not sent:
        return
    console.print("\nsent (topics without a subscriber on the other side do not cross a link):", soft_wrap=True)
    table = Table(box=SIMPLE_HEAD)
    for heading in ("topic", "messages/s", "Mbit/s"):
        table.add_column(heading, justify="left" if heading == "topic" else "right")
    for flow in sorted(sent, key=lambda flow: -flow.bytes_per_s):
        table.add_row(flow.topic, f"{flow.rate_hz:.1f}", f"{8e-6 * flow.bytes_per_s:.2f}")
    console.print(table)
