"""`spot3d results`: keeps what a robot's stages find, in a folder for each of its streams of frames."""

import logging
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import zenoh
from zenoh.handlers import Handler

from spot3d.dataflow.alive import watch_alive
from spot3d.dataflow.endpoints import subscribe_newest
from spot3d.dataflow.heartbeat import Heartbeat
from spot3d.dataflow.payload import arrived
from spot3d.dataflow.producers import Producers
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.streams import Streams
from spot3d.run.from_messages import NoMapError, asked_map, found_objects
from spot3d.run.overview import OverviewFrames
from spot3d.run.stream_folder import StreamFolder, drop_oldest
from spot3d_schemas import TOPICS, Message, Objects, Pose, Progress, key

log = logging.getLogger("spot3d.results")

_TOPICS = ("pose/pose", "fusion/progress", "fusion/objects")
_WAITING = 4096
"""Small messages that may wait while a picture is drawn: two minutes of a camera's; beyond that the oldest go."""
_POLL_S = 0.05
_WRITE_S = 10.0
"""Time between two writings of objects.json while a stream goes on."""
_MAP_S, _MAP_AT_STOP_S = 10.0, 3.0
"""Longest wait for the map, when a stream is complete and when this process is to end; no heartbeat meanwhile."""


def keep_results(link: LinkSettings, out: Path, keep: int, stop: threading.Event | None = None) -> None:
    """Write a folder below `out` for every stream of the robot, until stopped; at most `keep` of them are kept.

    No stage waits for this process. Raises OSError where `out` cannot be made.
    """
    out.mkdir(parents=True, exist_ok=True)
    with stop_on_signals(stop) as stopped, open_session(link, stopped) as session:
        _Keeper(session, link, out, keep).follow(stopped)


class _Keeper:
    """Writes the folder of the current stream."""

    def __init__(self, session: zenoh.Session, link: LinkSettings, out: Path, keep: int) -> None:
        self._session, self._robot, self._out, self._keep = session, link.robot, out, keep
        self._heartbeat = Heartbeat(link.heartbeat)
        self._seen = OverviewFrames(link.robot)
        self._streams = Streams()
        self._folder: StreamFolder | None = None
        self._written_s = float("-inf")

    def follow(self, stop: threading.Event) -> None:
        """Process messages until stopped."""
        with ExitStack() as stack:
            self._producers = Producers(stack.enter_context(watch_alive(self._session, self._robot)))
            keys = {topic: key(self._robot, topic) for topic in _TOPICS}
            inputs = {topic: subscribe_newest(self._session, keys[topic], _WAITING, stack) for topic in _TOPICS}
            stack.callback(self._seen.close)
            log.info("results of %s go to %s", self._robot, self._out.absolute())
            while not stop.wait(_POLL_S):
                self._drain(inputs)
                self._heartbeat.beat()
            self._finish(_MAP_AT_STOP_S)
        self._heartbeat.close()

    def _drain(self, inputs: dict[str, Handler[zenoh.Sample]]) -> None:
        heard = [
            message
            for topic, handler in inputs.items()
            for message in arrived(handler, TOPICS[topic].message)
            if self._producers.admit(topic, message.header.sender, time.monotonic())
        ]
        for message in _stream_by_stream(heard, self._streams.current):
            now_s = time.monotonic()
            verdict = self._streams.judge(message.header.stream, now_s)
            if verdict == "earlier":
                continue
            # A foreign source may name no stream; a folder that could not be made is tried again.
            if verdict == "begins" or (self._folder is None and now_s - self._written_s >= _WRITE_S):
                self._begin(self._streams.current)
            self._take(message)
        now_s = time.monotonic()
        if self._folder is not None:
            self._seen.look(self._session, self._folder.stream, now_s)
            if now_s - self._written_s >= _WRITE_S:
                self._write(self._folder)

    def _begin(self, stream: str | None) -> None:
        # Fusion has the next map already.
        self._finish(None)
        try:
            self._folder = StreamFolder(self._out, self._robot, stream, time.time())
            log.info("stream %s begins: %s", stream, self._folder.path)
            for gone in drop_oldest(self._out, self._keep, self._folder.path):
                log.info("%s is deleted: more than %d streams are kept", gone, self._keep)
        except OSError as error:
            log.error("cannot write results of stream %s: %s", stream, error)
        self._written_s = time.monotonic()

    def _take(self, message: Message) -> None:
        folder = self._folder
        if folder is None:
            return
        if isinstance(message, Pose):
            pose = None if message.status == "lost" else message.T_world_camera
            folder.pose(message.header.stamp_ns, pose, message.reason)
            self._seen.pose(message.header.stamp_ns, pose)
        elif isinstance(message, Progress):
            folder.progress = message
        elif isinstance(message, Objects):
            folder.update(message.header.stamp_ns, found_objects(message), message.complete)
            if message.complete:
                self._write(folder, _MAP_S)
                log.info(
                    "stream %s is complete: %d objects; results in %s", folder.stream, len(message.objects), folder.path
                )

    def _finish(self, map_s: float | None) -> None:
        """Close the current stream, complete or not."""
        folder, self._folder = self._folder, None
        if folder is not None:
            if not folder.complete:
                self._write(folder, map_s, last=True)
                log.info("stream %s ended incomplete; results in %s", folder.stream, folder.path)
            folder.close()
        self._seen.forget()

    def _write(self, folder: StreamFolder, map_s: float | None = None, last: bool = False) -> None:
        self._written_s = time.monotonic()
        points = None
        if map_s is not None:
            try:
                points, folder.no_map = asked_map(self._session, self._robot, map_s, folder.stream), ""
            except NoMapError as error:
                folder.no_map = f"no heatmap.ply: {error}"
                log.warning("stream %s has %s", folder.stream, folder.no_map)
        pictured = last or map_s is not None
        try:
            folder.write(points, self._seen.views if pictured else None)
        except OSError as error:
            log.error("the results of stream %s are incomplete: %s", folder.stream, error)


def _stream_by_stream(heard: Sequence[Message], current: str | None) -> list[Message]:
    """Messages of several topics, those of the current stream first: its last objects may come with the next's poses.

    A message that names no stream counts as one of the current stream, before the first as one of that.
    """
    current = current or next((message.header.stream for message in heard if message.header.stream), None)
    streams = dict.fromkeys((current, *(message.header.stream or current for message in heard)))
    place = {stream: number for number, stream in enumerate(streams)}
    return sorted(heard, key=lambda message: place[message.header.stream or current])
