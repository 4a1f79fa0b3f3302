"""`spot3d doctor`: looks at this device, the router, and every stage that answers."""

import threading
from collections.abc import Sequence
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from spot3d.cli_options import ConnectOption, RobotOption, SettingsOption, link_overrides
from spot3d.dataflow.settings import LinkSettings
from spot3d.doctor.finding import Finding
from spot3d.doctor.others import Flow
from spot3d.settings import load_settings

_CONNECT_S = 3.0
_STYLES = {"ok": "green", "note": "yellow", "problem": "bold red"}


def doctor(
    settings: SettingsOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    seconds: Annotated[float, typer.Option(min=1.5, help="how long rates are measured")] = 3.5,
) -> None:
    """Look at versions, clocks, certificates, kernels, memory and rates on every device; exit code 1 for a problem."""
    link = load_settings(settings, None, link_overrides(robot, connect, None, None)).link
    findings, sent = examine(link, seconds)
    console = Console()
    show(console, findings, sent)
    problems = sum(finding.level == "problem" for finding in findings)
    console.print(Text(f"{problems or 'no'} problem{'' if problems == 1 else 's'}", style="bold"))
    if problems:
        raise typer.Exit(1)


def examine(link: LinkSettings, seconds: float) -> tuple[list[Finding], list[Flow]]:
    """All findings about this device and, where the router answers, about the robot's stages; and what they send."""
    from spot3d.dataflow.alive import watch_alive
    from spot3d.dataflow.session import StoppedError, open_session
    from spot3d.dataflow.tls import TlsError
    from spot3d.doctor.asking import ask_all, measure_flows
    from spot3d.doctor.others import look_at
    from spot3d.doctor.this_device import look_here
    from spot3d_schemas import STAGES

    findings = look_here(link)
    stop = threading.Event()
    impatience = threading.Timer(_CONNECT_S, stop.set)
    impatience.daemon = True
    impatience.start()
    try:
        with open_session(link, stop) as session, watch_alive(session, link.robot) as alive:
            impatience.cancel()
            findings += reached(link)
            # The first second of measuring is also the time for the tokens to come.
            sent = measure_flows(session, link.robot, seconds)
            there = {stage: stage in alive for stage in STAGES}
            return findings + look_at(ask_all(session, link.robot), there), sent
    except TlsError:
        return [*findings, Finding("problem", "router", "not tried without a certificate", "see above")], []
    except StoppedError:
        return findings + reached(link, answered=False), []
    finally:
        impatience.cancel()


def reached(link: LinkSettings, answered: bool = True) -> list[Finding]:
    """The router's endpoints, and the certificates that it shows."""
    from spot3d.dataflow.tls import TlsError, probe, why_refused

    where = ", ".join(link.connect)
    if not answered:
        reason = why_refused(link) or "nobody answers"
        remedy = "start it, set [link] connect, and look at the way there: addresses, firewall, docs/security.md"
        return [Finding("problem", "router", f"{where}: {reason}", remedy)]
    findings = [Finding("ok", "router", f"reached at {where}")]
    for endpoint in link.connect:
        if endpoint.startswith("tls/"):
            try:
                shown = probe(endpoint, link)
            except TlsError as error:
                findings.append(Finding("note", "router", str(error), "another of its endpoints was reached"))
                continue
            remedy = "make it a new one: spot3d certificates --renew" if shown.soon_over else ""
            findings.append(Finding("problem" if remedy else "ok", "router's certificate", str(shown), remedy))
    return findings


def show(console: Console, findings: Sequence[Finding], sent: Sequence[Flow]) -> None:
    """Print what was found, one line each with what to do below it, and who sends how much."""
    for finding in findings:
        line = Text(f"{finding.level:8}", style=_STYLES[finding.level])
        line.append(f"{finding.what}: {finding.text}", style="default")
        console.print(line, soft_wrap=True)
        if finding.remedy:
            console.print(Text(f"        -> {finding.remedy}"), soft_wrap=True)
    if not sent:
        return
    table = Table(title="sent; what nobody on the other side subscribes to crosses no link", box=SIMPLE_HEAD)
    table.title_justify = "left"
    for heading in ("topic", "messages/s", "Mbit/s"):
        table.add_column(heading, justify="left" if heading == "topic" else "right")
    for flow in sorted(sent, key=lambda flow: -flow.bytes_per_s):
        table.add_row(flow.topic, f"{flow.rate_hz:.1f}", f"{8e-6 * flow.bytes_per_s:.2f}")
    console.print(table)
