"""Which stages are alive, and in which processes, according to their liveliness tokens."""

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import zenoh
from zenoh.handlers import FifoChannel, Handler

from spot3d.dataflow.stopping import end_threads
from spot3d_schemas import BRIDGE, STAGES, alive_key, token_of

_KNOWN = frozenset((*STAGES, BRIDGE))
"""Tokens with other names are ignored."""
_PROCESSES = 16
"""Maximum number of processes tracked per stage: anybody can declare tokens."""


class Alive:
    """The stages that are alive now, and their processes, named by the `sender` of their messages."""

    def __init__(self) -> None:
        self._stages: set[str] = set()
        self._processes: dict[str, set[str]] = {}
        self._changed = threading.Condition()

    def __contains__(self, stage: str) -> bool:
        with self._changed:
            return stage in self._stages

    def note(self, stage: str, there: bool) -> None:
        """Record that a stage has come or gone."""
        with self._changed:
            (self._stages.add if there else self._stages.discard)(stage)
            self._changed.notify_all()

    def note_process(self, stage: str, sender: str, there: bool) -> None:
        """Record that a process of a stage has come or gone."""
        with self._changed:
            processes = self._processes.setdefault(stage, set())
            if not there:
                processes.discard(sender)
            elif len(processes) < _PROCESSES:
                processes.add(sender)

    def processes(self, stage: str) -> frozenset[str]:
        """The processes of a stage that are alive now; there should be one at most."""
        with self._changed:
            return frozenset(self._processes.get(stage, ()))

    def missing(self, stages: tuple[str, ...], limit_s: float, stop: threading.Event) -> tuple[str, ...]:
        """Wait until all `stages` are there; returns those absent after `limit_s` or at a stop."""
        end_s = time.monotonic() + limit_s
        with self._changed:
            while absent := tuple(stage for stage in stages if stage not in self._stages):
                left_s = end_s - time.monotonic()
                if left_s <= 0 or stop.is_set():
                    return absent
                self._changed.wait(min(left_s, 0.1))
        return ()


def stages_by_robot(session: zenoh.Session, timeout_s: float, robot: str = "*") -> dict[str, frozenset[str]]:
    """The stages that are alive of each robot that is, or of one of them. Raises ZError if the session cannot ask."""
    alive: dict[str, set[str]] = {}
    for reply in session.liveliness().get(alive_key(robot, "*"), timeout=timeout_s):
        token = None if reply.ok is None else token_of(str(reply.ok.key_expr))
        if token is not None:
            alive.setdefault(token.robot, set()).add(token.stage)
    return {name: frozenset(stages) for name, stages in alive.items()}


def others_alive(session: zenoh.Session, robot: str, timeout_s: float) -> str:
    """Which other robots are alive, for who asks for one of which no process is; empty if one is after all.

    Raises ZError if the session cannot ask.
    """
    robots = sorted(name for name, stages in stages_by_robot(session, timeout_s).items() if stages & _KNOWN)
    if robot in robots:
        return ""
    return f"alive here: {', '.join(robots)}; choose one with --robot" if robots else "no robot is alive here"


@contextmanager
def watch_alive(session: zenoh.Session, robot: str) -> Iterator[Alive]:
    """Watches the stages of a robot and their processes, including those that are already alive."""
    alive = Alive()
    channel: FifoChannel[zenoh.Sample] = FifoChannel(64)
    tokens = alive_key(robot, "*")
    subscriber = session.liveliness().declare_subscriber(f"{tokens}/**", channel, history=True)
    follower = threading.Thread(target=_follow, args=(subscriber.handler, alive), name="alive", daemon=True)
    with ExitStack() as stack:
        stack.callback(end_threads, (follower,))
        stack.callback(subscriber.undeclare)
        follower.start()
        yield alive


def _follow(handler: Handler[zenoh.Sample], alive: Alive) -> None:
    for sample in handler:  # until the subscriber is undeclared
        token = token_of(str(sample.key_expr))
        if token is None or token.stage not in _KNOWN:
            continue
        there = sample.kind == zenoh.SampleKind.PUT
        if token.sender is None:
            alive.note(token.stage, there)
        else:
            alive.note_process(token.stage, token.sender, there)
