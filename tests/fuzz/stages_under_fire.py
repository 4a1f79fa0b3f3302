"""Every stage's real process, as threads of this one, fed with mutated messages by Zenoh.

Each stage is a robot of its own, so that it hears mutated messages only. Lossless, so that none is dropped unseen.
"""

import random
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import zenoh
from mutation import Mutator
from real_messages import real_messages

from spot3d.dataflow.process_use import process_use
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.fusion.process import run as run_fusion
from spot3d.fusion.settings import FusionSettings
from spot3d.heatmap.process import run as run_heatmap
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.pose.process import run as run_pose
from spot3d.pose.settings import PoseSettings
from spot3d.proposals.process import run as run_proposals
from spot3d.proposals.settings import ProposalSettings
from spot3d.segments.process import run as run_segments
from spot3d.segments.settings import SegmentsSettings
from spot3d_schemas import TOPICS, Message, alive_key, decode, encode, encoding, key

Run = Callable[[LinkSettings, threading.Event], None]

INPUTS = {
    "pose": ("source/frame",),
    "proposals": ("source/frame",),
    "heatmap": ("source/frame", "proposals/boxes"),
    "segments": ("heatmap/heat", "pose/pose"),
    "fusion": ("heatmap/heat", "pose/pose", "segments/segments", "source/end"),
}
ANSWERS = {
    "pose": "pose/pose",
    "proposals": "proposals/boxes",
    "heatmap": "heatmap/heat",
    "segments": "segments/segments",
    "fusion": "fusion/progress",
}
RUNS: dict[str, Run] = {
    "pose": lambda link, stop: run_pose(link, PoseSettings(), stop),
    "proposals": lambda link, stop: run_proposals(link, ProposalSettings(), stop),
    "heatmap": lambda link, stop: run_heatmap(link, HeatmapSettings(), stop),
    "segments": lambda link, stop: run_segments(link, SegmentsSettings(), stop),
    # A small map, which mutated poses fill soon: what grows after that is a leak.
    "fusion": lambda link, stop: run_fusion(link, FusionSettings(map_limit=20_000, keyframe_limit=20), stop),
}
LIMIT_S = 300.0
"""A stage that answers nothing for so long hangs; most of it is for compiling kernels at the start."""
_TRY_S = 2.0
"""Then newer captures are tried: the first may be taken for stragglers."""
_STEP_NS = 50_000_000
_JUMP_NS = 3_000_000_000
"""Captures that begin anew: whatever stamps were made up before, these are not behind them by a moment only."""


@dataclass
class Stage:
    """One stage's thread, what it was sent, and what it has answered: captures' stamps."""

    name: str
    thread: threading.Thread
    sent: int = 0
    answered: set[int] = field(default_factory=set)
    longest_s: float = 0.0

    @property
    def robot(self) -> str:
        """Whose messages it hears."""
        return f"fuzz-{self.name}"


@dataclass
class UnderFire:
    """The stages, and what went wrong in any thread."""

    session: zenoh.Session
    stages: dict[str, Stage]
    failures: list[str]
    captures: list[dict[str, Message]]
    now_ns: int = 10**18
    seq: int = 0
    publishers: dict[tuple[str, str], zenoh.Publisher] = field(default_factory=dict)

    def fire(self, mutator: Mutator, chance: random.Random) -> None:
        """One capture to every stage: of its messages some are as they were, most are mutated, some come twice."""
        self._next_capture(_STEP_NS)
        for stage in self.stages.values():
            for topic in INPUTS[stage.name]:
                if topic == "source/end" and chance.random() < 0.9:
                    continue
                payload = self._payload(topic)
                for _ in range(chance.choice((1, 1, 1, 2))):
                    mutated = (
                        payload if chance.random() < 0.2 else mutator.mutated(payload, chance.choice((1, 1, 2, 4)))
                    )
                    self._publishers(stage, topic).put(mutated)
                    stage.sent += 1

    def ask(self, chance: random.Random) -> None:
        """Queries with nonsense in them."""
        parameters = chance.choice(("", "limit=3", "limit=-1", "limit=x", f"limit={2**70}", "%00=;;=", "a=b;limit"))
        topic = chance.choice(("fusion/map", "fusion/map", "fusion/about", "fusion/reset"))
        selector = f"{key(self.stages['fusion'].robot, topic)}{'?' if parameters else ''}{parameters}"
        answers = [reply.ok for reply in self.session.get(selector, payload=chance.randbytes(20), timeout=LIMIT_S)]
        if not any(answers):
            time.sleep(1.0)  # a thread that dies needs a moment
            self.refuse_failures()
        assert any(answers), f"{selector} was not answered"

    def still_works(self) -> None:
        """Every stage answers captures that are as they should be, after whatever it was sent."""
        for stage in self.stages.values():
            start_s = time.monotonic()
            while not self._answers(stage):
                self.refuse_failures()
                waited_s = time.monotonic() - start_s
                assert waited_s < LIMIT_S, f"{stage.name} answers nothing for {waited_s:.0f} s"
            stage.longest_s = max(stage.longest_s, time.monotonic() - start_s)
        self.refuse_failures()

    def refuse_failures(self) -> None:
        """Raises AssertionError where a thread has died."""
        assert not self.failures, "\n".join(self.failures)
        dead = [stage.name for stage in self.stages.values() if not stage.thread.is_alive()]
        assert not dead, f"ended: {dead}"

    def _answers(self, stage: Stage) -> bool:
        self._next_capture(_JUMP_NS)
        for _ in range(3):
            self._next_capture(_STEP_NS)
            wanted_ns = self.now_ns
            for topic in INPUTS[stage.name]:
                if topic != "source/end":
                    self._publishers(stage, topic).put(self._payload(topic))
                    stage.sent += 1
            deadline_s = time.monotonic() + _TRY_S
            while time.monotonic() < deadline_s:
                if wanted_ns in stage.answered:
                    return True
                time.sleep(0.002)
        return False

    def _next_capture(self, step_ns: int) -> None:
        self.now_ns += step_ns
        self.seq += 1

    def _payload(self, topic: str) -> bytes:
        message = self.captures[self.seq % len(self.captures)][topic]
        header = message.header.model_copy(update={"stamp_ns": self.now_ns, "seq": self.seq})
        return encode(message.model_copy(update={"header": header}))

    def _publishers(self, stage: Stage, topic: str) -> zenoh.Publisher:
        where = (stage.robot, topic)
        if where not in self.publishers:
            self.publishers[where] = self.session.declare_publisher(
                key(*where),
                encoding=encoding(TOPICS[topic].message),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        return self.publishers[where]


@contextmanager
def under_fire(folder: Path) -> Iterator[UnderFire]:
    """Stages that are on line; they are told to end in the end. folder: for their snapshots."""
    stop = threading.Event()
    failures: list[str] = []
    endpoint = free_loopback_endpoint()

    def work(name: str) -> None:
        try:
            where = {"robot": f"fuzz-{name}", "connect": (endpoint,), "snapshot_folder": str(folder)}
            RUNS[name](LinkSettings(**where, snapshot_interval_s=1.0, delivery="lossless"), stop)
        except BaseException:
            failures.append(f"{name}: {traceback.format_exc()}")

    def died(args: threading.ExceptHookArgs) -> None:
        text = "".join(traceback.format_exception(args.exc_type, args.exc_value, args.exc_traceback))
        failures.append(f"{args.thread.name if args.thread else 'a thread'}: {text}")

    before, threading.excepthook = threading.excepthook, died
    with ExitStack() as stack:
        stack.callback(setattr, threading, "excepthook", before)
        session = stack.enter_context(open_router((endpoint,)))
        stages = {name: Stage(name, threading.Thread(target=work, args=(name,), name=name)) for name in RUNS}
        fired = UnderFire(session, stages, failures, real_messages("fuzz"))
        for stage in stages.values():
            _listen(session, stage)
            stack.callback(stage.thread.join)
        stack.callback(stop.set)
        for stage in stages.values():
            stage.thread.start()
        deadline_s = time.monotonic() + LIMIT_S
        while len(_alive(session)) < len(stages):
            fired.refuse_failures()
            assert time.monotonic() < deadline_s, f"on line are only {_alive(session)}"
            time.sleep(0.1)
        yield fired


def _alive(session: zenoh.Session) -> list[str]:
    replies = session.liveliness().get(alive_key("*", "*"), timeout=5.0)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


def _listen(session: zenoh.Session, stage: Stage) -> None:
    topic = ANSWERS[stage.name]

    def heard(sample: zenoh.Sample) -> None:
        stage.answered = {decode(sample.payload.to_bytes(), TOPICS[topic].message).header.stamp_ns, *stage.answered}
        if len(stage.answered) > 1000:
            stage.answered = set()

    session.declare_subscriber(key(stage.robot, topic), heard)


def rss_mb() -> float:
    """Memory of this process now."""
    return process_use().rss_bytes / 2**20
