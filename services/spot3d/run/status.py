"""`spot3d status`: the present state of a robot's stages, and the objects found and left out."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import zenoh
from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from spot3d.dashboard.health import StageRecords, Word
from spot3d.dataflow.alive import others_alive, watch_alive
from spot3d.dataflow.endpoints import subscribe_newest
from spot3d.dataflow.payload import arrived
from spot3d.dataflow.rate_limited_log import printable
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d.dataflow.tls import why_unreached
from spot3d_schemas import BRIDGE, STAGES, Health, Objects, key

_CONNECT_S = 3.0
"""Longest wait for the router."""
_LISTEN_S = 2.5
"""One shot: each stage publishes its health once a second."""
_REFRESH_S = 0.5
_READERS = ("pose", "proposals", "heatmap")
"""Stages that work on the frames themselves."""
_STYLES = {"good": "green", "waits": "yellow", "bad": "red", "ended": "dim"}


class _Robot:
    """The latest state of a robot: which stages are alive, their health, and the objects found."""

    def __init__(self, session: zenoh.Session, name: str, stack: ExitStack) -> None:
        self._name, self._alive = name, stack.enter_context(watch_alive(session, name))
        self._handlers = {
            stage: subscribe_newest(session, key(name, f"{stage}/health"), 1, stack) for stage in (*STAGES, BRIDGE)
        }
        self._objects_ear = subscribe_newest(session, key(name, "fusion/objects"), 1, stack, kept=True)
        self._records = StageRecords()
        self._health: dict[str, Health] = {}
        self._objects: Objects | None = None

    def listen(self, duration_s: float) -> None:
        """Receive for this long; the first time only until each stage has published its health."""
        end_s = time.monotonic() + duration_s
        fresh = not self._health
        while time.monotonic() < end_s and not (fresh and self._processes().keys() <= self._health.keys()):
            for stage, ear in self._handlers.items():
                for health in arrived(ear, Health):
                    # Anybody can publish under the key of a stage; a message that names another is not that stage's.
                    if health.stage == stage:
                        self._health[stage] = health
                        self._records.receive(health, time.monotonic())
            for objects in arrived(self._objects_ear, Objects):
                self._objects = objects
            time.sleep(0.02)

    def table(self) -> Group:
        """See `status_table`."""
        return status_table(self._name, self._processes(), self._health, self._objects)

    def words(self) -> Text:
        """See `words_of_stages`."""
        there = [stage for stage, count in self._processes().items() if count]
        complete = self._objects is not None and self._objects.complete
        return words_of_stages(self._records.words(there, time.monotonic(), complete=complete))

    def is_away(self) -> bool:
        """Whether nothing of this robot is alive."""
        return not any(self._processes().values())

    def all_is_well(self) -> bool:
        """Whether every stage is alive, except a source that has ended, and none states a problem."""
        there = self._processes()
        ended = has_ended(there, self._objects)
        alive = all(count or (ended and stage == "source") for stage, count in there.items())
        return alive and not any(item.state for item in self._health.values())

    def _processes(self) -> dict[str, int]:
        """Number of processes of each stage, and of the bridge, if any; one without a name counts as one."""
        shown = (*STAGES, BRIDGE) if BRIDGE in self._alive else STAGES
        return {stage: max(len(self._alive.processes(stage)), int(stage in self._alive)) for stage in shown}


def show_status(link: LinkSettings, console: Console, watch: bool) -> bool:
    """Print the table once, or keep it up to date until Ctrl-C; returns whether every stage is alive and all is well.

    A missing source is no fault if its recording has ended, and fusion has accounted for all of it.
    Raises ConnectionError where no router answers, or none lets this side in.
    """
    with ExitStack() as stack:
        try:
            session = stack.enter_context(open_session(link, patience_s=_CONNECT_S))
        except StoppedError:
            start = "start the dataflow, or give the router's address with --connect"
            reason, remedy = why_unreached(link, start)
            reason = reason or f"no router answers at {', '.join(link.connect)}"
            raise ConnectionError(f"{reason}; {remedy}") from None
        robot = _Robot(session, link.robot, stack)
        if watch:
            _watch(robot, console)
            return True
        robot.listen(_LISTEN_S)
        console.print(robot.table())
        if robot.is_away():
            console.print(others_alive(session, link.robot, _LISTEN_S))
        return robot.all_is_well()


def has_ended(alive: Mapping[str, int], objects: Objects | None) -> bool:
    """Whether the source is gone because its recording is over, and `objects` are those of all its frames."""
    return not alive["source"] and objects is not None and objects.complete


def status_table(
    robot: str, alive: Mapping[str, int], health: Mapping[str, Health], objects: Objects | None = None
) -> Group:
    """One row per stage: whether it is alive, its rate, its core's time, its lag behind the source, its drops.

    alive: processes of each stage. Below: what is wrong now, why messages were dropped, and the last error; the objects
    of the latest update, and what it left out. Fits into 80 columns.
    """
    table = Table(title=f"robot {robot}", title_justify="left", box=SIMPLE_HEAD)
    for heading in ("stage", "alive", "frames/s", "step ms p50/p99", "lag ms p50/p99", "dropped", "errors", "MB"):
        left = heading in ("stage", "alive")
        table.add_column(heading, justify="left" if left else "right", no_wrap=" " not in heading)
    details, ended = [], has_ended(alive, objects)
    for stage, there in alive.items():
        state = "[green]yes" if there == 1 else f"[red]{there} times" if there else "[red]no"
        if ended and stage == "source":
            state = "ended"
        item = health.get(stage)
        if there > 1:
            text = f"{there} processes of {stage} are running, but only one is used: end the others"
            details.append(Text(text, style="bold red"))
        if item is not None and item.state:
            details.append(Text(printable(f"{stage}: {item.state}"), style="bold red"))
        if item is None:
            table.add_row(stage, state, *["-"] * 6)
            continue
        table.add_row(
            stage,
            state,
            "-" if item.rate_hz is None or stage == BRIDGE else f"{item.rate_hz:.1f}",
            _pair(item.step_ms_p50, item.step_ms_p99),
            _pair(item.latency_ms_p50, item.latency_ms_p99),
            str(sum(item.drops.values())),
            str(item.errors),
            f"{item.rss_bytes / 2**20:.0f}",
        )
        if item.drops:
            reasons = ", ".join(f"{count} {reason}" for reason, count in item.drops.items())
            details.append(Text(printable(f"{stage} dropped: {reasons}"), style="yellow"))
        if item.errors:
            details.append(Text(printable(f"{stage}: {item.last_error}"), style="red"))
    if any(item.events.get("streams", 0) > 1 and (item.drops or item.errors) for item in health.values()):
        details.append(Text("dropped and errors: since each stage's start, so of earlier streams as well"))
    readers = [health[stage] for stage in _READERS if stage in health]
    if ended:
        details.append(Text("the recording has ended, and all of its frames are accounted for"))
    elif readers and all(item.rate_hz == 0 for item in readers):
        text = f"{', '.join(item.stage for item in readers)} received no frame in the last second"
        details.append(Text(printable(text), style="yellow"))
    if objects is not None:
        left_out = ", ".join(f"{count} {reason}" for reason, count in objects.left_out.items())
        text = f"objects: {len(objects.objects)}" + (f"; left out: {left_out}" if left_out else "")
        details.append(Text(printable(text)))
    return Group(table, *details)


def words_of_stages(words: Sequence[Word]) -> Text:
    """One line per stage: its state, in words."""
    text = Text()
    for word in words:
        text.append(f"{word.stage:10}", style="bold")
        text.append(f"{printable(word.text)}\n", style=_STYLES[word.level])
    return text


def _watch(robot: _Robot, console: Console) -> None:
    try:
        with Live(console=console, auto_refresh=False) as live:
            while True:
                robot.listen(_REFRESH_S)
                live.update(Group(robot.words(), robot.table()), refresh=True)
    except KeyboardInterrupt:
        return


def _pair(p50: float | None, p99: float | None) -> str:
    return "-" if p50 is None or p99 is None else f"{p50:.1f} / {p99:.0f}"
