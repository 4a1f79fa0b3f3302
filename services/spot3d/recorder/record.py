"""The recorder's process: writes a robot's messages to an MCAP file without delaying any frame."""

import fnmatch
import json
import logging
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import zenoh
from zenoh.handlers import FifoChannel, Handler, RingChannel

import spot3d
from spot3d.dataflow.alive import others_alive
from spot3d.dataflow.endpoints import waiting
from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.session import open_session
from spot3d.dataflow.stopping import StoppedError, end_threads, stop_on_signals
from spot3d.recorder.backlog import Backlog
from spot3d.recorder.mcap_writer import ChannelSpec
from spot3d.recorder.packer import Packer
from spot3d.settings import Settings, to_toml
from spot3d_schemas import TOPICS, CodecError, alive_key, encoding, json_schema, key, peek_header, refuse_encoding

log = logging.getLogger(__name__)

RECORDER = "recorder"
"""Name in the recorder's liveliness token, in the place of a stage's name."""
BACKLOG_BYTES = 256 * 2**20
"""Largest memory for messages that wait for the disk: two seconds of a VGA camera with all messages made from it."""
_FRAMES = ("source/frame", "heatmap/heat")
_WAITING = 4
"""Least size of a topic's queue before the copy. It is small because queued messages keep the sender's shared memory,
and a sender that has none left sends images through sockets."""
_IDLE_S = 0.1
_ASKED_S = 1.0
"""Longest wait for the answer which robots are alive; messages are received meanwhile."""


@dataclass(slots=True)
class Recorded:
    """The outcome of a recording.

    messages: number in the file by topic; skipped: number missing, by topic and reason; error: why it ended early, or
    empty.
    """

    path: Path
    messages: dict[str, int] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)
    size: int = 0
    seconds: float = 0.0
    error: str = ""

    def summary(self) -> str:
        """A summary in one line."""
        left_out = ", ".join(f"{count} {reason}" for reason, count in sorted(self.skipped.items()))
        return (
            f"{self.path}: {'' if not self.error else f'{self.error}; it holds the first '}{self.seconds:.1f} s, "
            f"{sum(self.messages.values())} messages of {len(self.messages)} topics, {self.size / 1e6:.1f} MB"
            f"; {f'skipped: {left_out}' if left_out else 'nothing skipped'}"
        )


class NoSuchTopicError(Exception):
    """A pattern matches no topic. The message lists the topics."""


def matching_topics(patterns: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """The known topics that match a pattern (`source/*`); without patterns, all. Raises NoSuchTopicError."""
    for pattern in patterns:
        if not fnmatch.filter(known, pattern):
            raise NoSuchTopicError(f"no topic matches {pattern!r}; choose from {', '.join(known)}")
    return tuple(topic for topic in known if not patterns or any(fnmatch.fnmatch(topic, item) for item in patterns))


def published_topics() -> list[str]:
    """Every published topic, without queries."""
    return [topic.name for topic in TOPICS.values() if topic.kind == "pub"]


def record(settings: Settings, path: Path, topics: Sequence[str], stop: threading.Event | None = None) -> Recorded:
    """Record topics of the link's robot into a new file at `path` until stopped, or until the disk is full.

    In a live run, messages that cannot be written in time are skipped and counted. In a lossless run the senders wait.
    Raises FileExistsError, and OSError where nothing can be written at all.
    """
    with stop_on_signals(stop) as stopped:
        recorder = _Recorder(settings, path, topics)
        try:
            with closing(recorder), suppress(StoppedError):
                recorder.run(stopped)
        except OSError:
            # For example, it cannot subscribe. An empty file would block the next attempt.
            if not any(recorder.recorded.messages.values()):
                path.unlink(missing_ok=True)
            raise
        return recorder.recorded


class _Recorder:
    def __init__(self, settings: Settings, path: Path, topics: Sequence[str]) -> None:
        self.recorded = Recorded(path)
        self._link = settings.link
        self._topics = tuple(topics)
        self._backlog = Backlog(BACKLOG_BYTES)
        self._limited_log = RateLimitedLog(log)
        self._lock = threading.Lock()
        self._packer = Packer(path, self._backlog, self._link.delivery)
        about = {
            "spot3d": spot3d.__version__,
            "zenoh": version("eclipse-zenoh"),
            "robot": self._link.robot,
            "delivery": self._link.delivery,
            "topics": " ".join(self._topics),
        }
        self._packer.metadata("spot3d", about)
        self._packer.metadata("settings", {"toml": to_toml(settings)})
        self._channels = {topic: self._packer.channel(topic_channel(self._link.robot, topic)) for topic in self._topics}
        self._frames = next((topic for topic in _FRAMES if topic in self._topics), None)

    def run(self, stop: threading.Event) -> None:
        """Record until stopped."""
        with ExitStack() as stack:
            session = stack.enter_context(open_session(self._link, stop))
            threads: list[threading.Thread] = []
            stack.callback(end_threads, threads)
            stack.callback(self._backlog.close)
            for topic in self._topics:
                where = key(self._link.robot, topic)
                subscriber = stack.enter_context(session.declare_subscriber(where, self._channel(topic)))
                reader = threading.Thread(target=self._hear, args=(topic, subscriber.handler), name=topic, daemon=True)
                threads.append(reader)
                reader.start()
            # The token comes after the subscriptions: whoever sees it can start sending.
            stack.enter_context(session.liveliness().declare_token(alive_key(self._link.robot, RECORDER)))
            log.info("recording %s topics of %s into %s", len(self._topics), self._link.robot, self.recorded.path)
            if others := others_alive(session, self._link.robot, _ASKED_S):
                log.warning("no stage of robot %s is alive yet; %s", self._link.robot, others)
            self._write(stop)

    def close(self) -> None:
        """Finish the file. Messages that cannot be written are dropped, and the error is kept."""
        packer, recorded = self._packer, self.recorded
        packer.hurry()
        while not packer.error and (item := self._backlog.get(0)) is not None:
            packer.add(self._channels[item.topic], item)
        packer.finish(self._frames or "", {reason: str(count) for reason, count in recorded.skipped.items()})
        by_channel = {number: topic for topic, number in self._channels.items()}
        recorded.messages = {by_channel[number]: count for number, count in sorted(packer.kept.items())}
        recorded.size, recorded.error = packer.size, packer.error
        recorded.seconds = 1e-9 * (packer.end_ns - packer.start_ns)

    def _channel(self, topic: str) -> "FifoChannel[zenoh.Sample] | RingChannel[zenoh.Sample]":
        """The topic's queue. Live, a full one drops the oldest message: a sender that waits for one waits for all."""
        size = max(waiting(topic, self._link), _WAITING)
        return FifoChannel(size) if self._link.delivery == "lossless" else RingChannel(size)

    def _write(self, stop: threading.Event) -> None:
        while not (stop.is_set() or self._packer.error):
            # A process that hangs takes no orders; what waits for it must not keep the recorder from being stopped.
            if self._packer.ready(_IDLE_S) and (item := self._backlog.get(_IDLE_S)) is not None:
                self._packer.add(self._channels[item.topic], item)

    def _hear(self, topic: str, handler: Handler[zenoh.Sample]) -> None:
        """Copy messages of a topic to the backlog. In a live run it never waits for the disk."""
        expected, last = TOPICS[topic].message, None
        for sample in handler:  # until the subscription has ended
            try:
                refuse_encoding(str(sample.encoding), expected)
                if self._link.delivery == "live" and not self._backlog.has_room(len(sample.payload)):
                    self._skip(topic, "not written in time")
                    last = None  # its sequence number is unknown
                    continue
                data = intact_bytes(sample.payload)
                if data is None:
                    self._skip(topic, "overwritten")
                    continue
                header = peek_header(data)
            except CodecError as error:
                self._skip(topic, "refused", str(error))
                continue
            if last is not None and header.sender == last.sender and header.seq > last.seq + 1:
                self._skip(topic, "lost on the way", count=header.seq - last.seq - 1)
            last = header
            sent_ns = header.trace[-1].sent_ns if header.trace else time.time_ns()
            place = (header.stamp_ns, header.stream or "") if topic == self._frames else None
            if not self._backlog.put(topic, sent_ns, header.seq, data, self._link.delivery == "lossless", place):
                self._skip(topic, "not written in time")

    def _skip(self, topic: str, reason: str, why: str = "", count: int = 1) -> None:
        with self._lock:
            self.recorded.skipped[f"{topic} {reason}"] += count
        self._limited_log.say(f"{topic} {reason}", f"{topic} {reason}{why and f': {why}'}", time.monotonic())


def topic_channel(robot: str, topic: str) -> ChannelSpec:
    """A topic's MCAP channel: its key, its message's JSON Schema, and the metadata to publish it again."""
    message = TOPICS[topic].message
    schema = json.dumps(json_schema(message)).encode()
    about = {"topic": topic, "robot": robot, "encoding": encoding(message)}
    return key(robot, topic), message.SCHEMA, schema, "jsonschema", "msgpack", about
