"""Real stages for the dataflow's system tests: processes, a small recording, and an ear on what they say."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import Any, Self, TypeVar

import numpy as np
import zenoh
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.dataflow.conversion import intrinsics_message
from spot3d.dataflow.process_use import SINGLE_THREADED
from spot3d.dataflow.settings import LinkSettings
from spot3d.frame import RgbdFrame
from spot3d.source.process import run as run_source
from spot3d.source.sequence import FrameSequence, FrameStream
from spot3d.source.settings import SourceSettings
from spot3d_schemas import (
    TOPICS,
    Frame,
    Header,
    Health,
    Message,
    Objects,
    Progress,
    alive_key,
    decode,
    key,
    process_key,
)

M = TypeVar("M", bound=Message)

STAGES = ("pose", "proposals", "heatmap", "segments", "fusion")
LIMIT_S = 120.0
"""Most of it is for compiling kernels, where they are not cached yet."""
CAMERA = Intrinsics(140.0, 140.0, 79.5, 59.5, 160, 120)
PERIOD_NS = 50_000_000

_STAGE = """
import importlib, sys
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import end_with_any_thread
end_with_any_thread()
stage, link = sys.argv[1], LinkSettings.model_validate_json(sys.argv[2])
names = {"pose": "PoseSettings", "proposals": "ProposalSettings", "heatmap": "HeatmapSettings",
         "segments": "SegmentsSettings", "fusion": "FusionSettings"}
settings = getattr(importlib.import_module(f"spot3d.{stage}.settings"), names[stage])
chosen = {"provider": sys.argv[3]} if stage == "pose" else {}
importlib.import_module(f"spot3d.{stage}.process").run(link, settings(**chosen))
"""


class Recording(FrameSequence):
    """Frames of a box that stands out of a wall, 160x120, true poses, stamps 50 ms apart."""

    intrinsics = CAMERA
    has_true_poses = True

    def __init__(self, frames: int, start_ns: int = 0) -> None:
        self.stamps_ns = [start_ns + index * PERIOD_NS for index in range(frames)]

    def true_pose(self, index: int) -> NDArray[np.float64]:
        """The camera drifts along x."""
        T = np.eye(4)
        T[0, 3] = 1e-3 * index
        return T

    def __getitem__(self, index: int) -> RgbdFrame:
        rng = np.random.default_rng(index)
        colour = np.full((120, 160, 3), (90, 110, 130), np.uint8)
        colour[40:80, 60:100] = (200, 60, 40)
        colour += rng.integers(0, 8, colour.shape, np.uint8)
        depth = np.full((120, 160), 1200, np.uint16)
        depth[40:80, 60:100] = 1000
        return RgbdFrame(self.stamps_ns[index], colour, depth, 0.001, CAMERA, self.true_pose(index))


@contextmanager
def playing(
    link: LinkSettings, recording: FrameSequence | FrameStream, **options: object
) -> Iterator[threading.Thread]:
    """A source in a thread of this process, ended at last."""
    stop = threading.Event()
    arguments = {"link": link, "settings": SourceSettings(), "sequence": recording, "stop": stop, **options}
    thread = threading.Thread(target=run_source, kwargs=arguments)
    thread.start()
    try:
        yield thread
    finally:
        stop.set()
        thread.join(20)
        assert not thread.is_alive()


def frame_message(frame: RgbdFrame, robot: str, seq: int) -> Frame:
    """A frame as a foreign source would send it."""
    now_ns = time.time_ns()
    header = Header(robot=robot, seq=seq, stamp_ns=frame.stamp_ns, frame_id="camera")
    return Frame(
        header=header.with_hop("source", now_ns, now_ns),
        intrinsics=intrinsics_message(frame.intrinsics),
        depth_scale=frame.depth_scale,
        colour=frame.colour,
        depth=frame.depth,
        T_world_camera=frame.T_world_camera,
    )


class Stages:
    """Stages of one robot, each a process of its own. pose: where poses come from."""

    def __init__(self, link: LinkSettings, pose: str = "given") -> None:
        self._pose = pose
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._folder = TemporaryDirectory()
        self.link = link.model_copy(update={"snapshot_folder": self._folder.name})

    def __enter__(self) -> Self:
        return self

    def start(self, *stages: str) -> None:
        """Start stages; those that are known already start again."""
        environment = {**os.environ, **SINGLE_THREADED}
        for stage in stages:
            command = [sys.executable, "-c", _STAGE, stage, self.link.model_dump_json(), self._pose]
            self.processes[stage] = subprocess.Popen(command, env=environment)

    def kill(self, stage: str) -> None:
        """SIGKILL: nothing of the stage's own runs any more."""
        self.processes[stage].kill()
        self.processes[stage].wait(10)

    def end(self, stage: str) -> int:
        """SIGTERM, as a container's stop; the exit code."""
        self.processes[stage].terminate()
        return self.processes[stage].wait(20)

    def stop(self) -> dict[str, int]:
        """SIGTERM for all; their exit codes."""
        for process in self.processes.values():
            process.terminate()
        return {stage: process.wait(20) for stage, process in self.processes.items()}

    def __exit__(self, *_: object) -> None:
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
                process.wait(10)
        self._folder.cleanup()


@dataclass
class Ear:
    """Everything that a robot's stages have said, by topic."""

    heard: dict[str, list[Any]]
    changed: threading.Condition

    def wait(self, what: Callable[[], bool], limit_s: float = LIMIT_S) -> None:
        """Wait until `what` holds. Raises TimeoutError, with the last progress, where it does not."""
        with self.changed:
            if not self.changed.wait_for(what, limit_s):
                raise TimeoutError(f"not within {limit_s} s; the last progress: {self.progress}")

    def wait_complete(self, recording: FrameSequence) -> Progress:
        """Wait for fusion's word that a recording is complete, and return it: its source may have heard it before.

        No other recording that is heard may have its last stamp.
        """
        end_ns, complete = recording.stamps_ns[-1], []

        def said() -> bool:
            complete[:] = [
                word for word in self.heard["fusion/progress"] if word.complete and word.last_stamp_ns == end_ns
            ]
            return bool(complete)

        self.wait(said)
        return complete[-1]

    def reached(self, stamp_ns: int) -> bool:
        """Whether fusion is done with the frame of this stamp, and has said so."""
        return any(word.last_stamp_ns == stamp_ns for word in self.heard["fusion/progress"])

    @property
    def progress(self) -> Progress | None:
        """The last progress, if there was any."""
        heard: list[Progress] = self.heard["fusion/progress"]
        return heard[-1] if heard else None

    @property
    def objects(self) -> list[Objects]:
        """All updates of the objects."""
        return self.heard["fusion/objects"]

    @property
    def objects_of_now(self) -> Objects | None:
        """The last update of the objects, if it is of the stream that fusion is in."""
        last = self.objects[-1] if self.objects else None
        return last if last is not None and last.header.stream == self.stream else None

    def health(self, stage: str) -> Health | None:
        """The stage's last health, if there was any."""
        heard: list[Health] = self.heard[f"{stage}/health"]
        return heard[-1] if heard else None

    @property
    def stream(self) -> str | None:
        """The stream that fusion is in, as its last progress says."""
        return self.progress.header.stream if self.progress else None

    @property
    def fused(self) -> int:
        """Frames that the fusion of now has fused."""
        return self.progress.fused if self.progress else 0


@contextmanager
def listening(session: zenoh.Session, robot: str, *more: str) -> Iterator[Ear]:
    """An ear for a robot's progress, objects, healths and `more` topics."""
    topics = ["fusion/progress", "fusion/objects", *(f"{stage}/health" for stage in STAGES), *more]
    ear = Ear({topic: [] for topic in topics}, threading.Condition())

    def hear(topic: str) -> Callable[[zenoh.Sample], None]:
        def put(sample: zenoh.Sample) -> None:
            message = decode(sample.payload.to_bytes(), TOPICS[topic].message)
            with ear.changed:
                ear.heard[topic].append(message)
                ear.changed.notify_all()

        return put

    with ExitStack() as stack:
        for topic in topics:
            subscriber = session.declare_subscriber(key(robot, topic), hear(topic))
            stack.callback(subscriber.undeclare)
        yield ear


def alive_stages(session: zenoh.Session, robot: str) -> set[str]:
    """The stages whose tokens are there now."""
    replies = session.liveliness().get(alive_key(robot, "*"), timeout=5)
    return {str(reply.ok.key_expr).split("/")[2] for reply in replies if reply.ok is not None}


def wait_alive(session: zenoh.Session, robot: str, stages: set[str]) -> None:
    """Wait until exactly these stages are alive. Raises TimeoutError."""
    end_s = time.monotonic() + LIMIT_S
    while (there := alive_stages(session, robot)) != stages:
        if time.monotonic() > end_s:
            raise TimeoutError(f"alive: {sorted(there)}; expected {sorted(stages)}")
        time.sleep(0.05)


def wait_gone(session: zenoh.Session, robot: str, stage: str) -> None:
    """Wait until no process of this stage is there: until then, it alone is heard. Raises TimeoutError."""
    end_s = time.monotonic() + LIMIT_S
    while list(session.liveliness().get(process_key(robot, stage, "*"), timeout=5)):
        if time.monotonic() > end_s:
            raise TimeoutError(f"a process of {stage} is still there")
        time.sleep(0.05)
