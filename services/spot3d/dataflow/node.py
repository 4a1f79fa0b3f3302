"""The process around a core: one Zenoh session, the stage's topics, its health and its end."""

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from typing import Any, Generic, Self, TypeVar

import zenoh
from zenoh.handlers import FifoChannel, Handler

from spot3d.camera import Intrinsics, off_centre
from spot3d.dataflow.about import about
from spot3d.dataflow.admission import PER_FRAME, Admission
from spot3d.dataflow.alive import watch_alive
from spot3d.dataflow.clocks import Clocks, one_clock
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.endpoints import declare_publisher, declare_subscriber, has_subscribers, keeps_newest, waiting
from spot3d.dataflow.heartbeat import STUCK_S, Heartbeat
from spot3d.dataflow.inbox import Inbox, Tray
from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.process_use import process_use, stay_single_threaded
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import end_threads
from spot3d.dataflow.streams import Streams, new_stream
from spot3d_schemas import (
    TOPICS,
    CameraIntrinsics,
    CodecError,
    Frame,
    Header,
    Message,
    alive_key,
    decode,
    encode,
    encoding,
    key,
    process_key,
    refuse_encoding,
)

M_co = TypeVar("M_co", bound=Message, covariant=True)

_OF_A_STREAM = PER_FRAME | {"source/end"}
"""Topics that belong to a stream of captures."""
_QUERIES_WAITING = 4
_IDLE_S = 0.1
"""Longest interval between two checks of the stop event."""


@dataclass(frozen=True, slots=True)
class Received(Generic[M_co]):
    """A valid message and its time of arrival, wall clock.

    recording: how often the topic's stamps had gone back, each time to another, unannounced recording.
    begins: whether it is the first message of another stream of captures.
    """

    message: M_co
    received_ns: int
    recording: int = 0
    begins: bool = False


class Node:
    """A stage's connection to the other stages, for as long as its `with` block is entered.

    Each input has a thread that decodes, checks and counts messages and puts them into the inbox; the stage's own
    thread reads it by `next`. The liveliness token is declared after the subscriptions: whoever sees it can send.
    state: what is wrong with the stage now, for people; the stage sets it, and health messages contain it.
    """

    def __init__(
        self,
        stage: str,
        link: LinkSettings,
        stop: threading.Event,
        inputs: tuple[str, ...] = (),
        outputs: tuple[str, ...] = (),
        queries: tuple[str, ...] = (),
    ) -> None:
        self.stage, self.link, self.stop = stage, link, stop
        self.counters = Counters(stage, time.monotonic())
        self._inputs, self._queries = inputs, queries
        self._outputs = (*outputs, f"{stage}/health")
        trays = {topic: Tray(waiting(topic, link), keeps_newest(topic, link)) for topic in inputs}
        self._inbox = Inbox(trays | {topic: Tray(_QUERIES_WAITING, False) for topic in queries})
        self.state = ""
        self.sender = new_stream()
        self._camera: CameraIntrinsics | None = None
        self._streams, self._clocks = Streams(), Clocks()
        self._about = f"{stage}/about"
        self._seqs = dict.fromkeys((*self._outputs, *queries, self._about), 0)
        self._log = logging.getLogger(f"spot3d.{stage}")
        self._limited_log = RateLimitedLog(self._log)
        self._heartbeat, self._turned_s = Heartbeat(link.heartbeat), time.monotonic()
        self._gone = threading.Event()
        self._exit = ExitStack()

    def __enter__(self) -> Self:
        stay_single_threaded()
        with ExitStack() as stack:
            session = stack.enter_context(open_session(self.link, self.stop))
            self.session = session
            stack.enter_context(
                session.liveliness().declare_token(process_key(self.link.robot, self.stage, self.sender))
            )
            self.alive = stack.enter_context(watch_alive(session, self.link.robot))
            self._admission = Admission(self._inputs, self.link, self.alive, self.counters, self._limited_log)
            self._publishers = {topic: declare_publisher(session, topic, self.link) for topic in self._outputs}
            threads = [threading.Thread(target=self._report, name="health", daemon=True)]
            stack.callback(end_threads, threads)
            for topic in self._inputs:
                subscriber = stack.enter_context(declare_subscriber(session, topic, self.link))
                threads.append(_reader(self._receive, topic, subscriber.handler))
            for topic in (*self._queries, self._about):
                channel: FifoChannel[zenoh.Query] = FifoChannel(_QUERIES_WAITING)
                where = key(self.link.robot, topic)
                queryable = stack.enter_context(session.declare_queryable(where, channel, complete=True))
                answering = self._tell if topic == self._about else self._ask
                threads.append(_reader(answering, topic, queryable.handler))
            stack.enter_context(session.liveliness().declare_token(alive_key(self.link.robot, self.stage)))
            for thread in threads:
                thread.start()
            stack.callback(self._leave)
            self._exit = stack.pop_all()
        self._log.info("%s of robot %s is on line", self.stage, self.link.robot)
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def next(self, timeout_s: float = _IDLE_S) -> tuple[str, Any] | None:
        """The next input: its topic and a `Received`, or a zenoh.Query; None where nothing came in time.

        Messages of an earlier stream are dropped and counted.
        """
        self.turn()
        item = self._inbox.get(min(timeout_s, _IDLE_S))
        if item is None or item[0] not in _OF_A_STREAM:
            return item
        topic, given = item
        stream = given.message.header.stream
        verdict = self._streams.judge(stream, time.monotonic())
        if verdict == "earlier":
            self.counters.drop(f"{topic} of an earlier stream")
            return None
        if verdict == "begins":
            self.counters.event("streams")
            self._log.info("stream %s begins", stream)
            return topic, replace(given, begins=True)
        return item

    def rest(self, duration_s: float) -> None:
        """Sleep for this long, or until the stage is to stop."""
        end_s = time.monotonic() + duration_s
        while (left_s := end_s - time.monotonic()) > 0 and not self.stop.wait(min(left_s, 1.0)):
            self.turn()

    def turn(self) -> None:
        """Note that the stage's own thread does not hang, though it may leave its inputs waiting."""
        self._turned_s = time.monotonic()

    @property
    def stream(self) -> str | None:
        """The stage's current stream of captures, if its source names it."""
        return self._streams.current

    def header(self, topic: str, given: Received[Message]) -> Header:
        """The header of this stage's output on `topic` for a message: same capture, one more hop."""
        header = given.message.header
        return self.numbered(topic, header.with_hop(self.stage, given.received_ns, time.time_ns()))

    def numbered(self, topic: str, header: Header) -> Header:
        """The header with this robot's name, this process and the topic's next sequence number."""
        seq = self._seqs[topic]
        self._seqs[topic] = seq + 1
        return header.model_copy(update={"robot": self.link.robot, "seq": seq, "sender": self.sender})

    def wanted(self, topic: str) -> bool:
        """Whether anybody subscribes to an output; see `has_subscribers`."""
        return has_subscribers(self._publishers[topic])

    def publish(self, topic: str, message: Message, jpeg_quality: int | None = None) -> bool:
        """Send a message; returns whether it was sent. A failure is counted as an error.

        jpeg_quality: compress with this quality, whatever the link is.
        """
        thin, quality = self.link.thin_link or jpeg_quality is not None, jpeg_quality or self.link.jpeg_quality
        try:
            payload = encode(message, thin_link=thin, jpeg_quality=quality)
            self._publishers[topic].put(payload)
        except (CodecError, zenoh.ZError) as error:
            self.failed(topic, f"cannot send {topic}: {error}")
            return False
        self.counters.published(topic, len(payload))
        return True

    def measure_latency(self, header: Header) -> None:
        """Record the time since the frame of this header left its source, for messages that are sent now."""
        if len(header.trace) > 1:
            way_ns = header.trace[-1].sent_ns - header.trace[0].sent_ns
            self.counters.latency(way_ns if one_clock(header.trace) else None)

    def reply(self, query: zenoh.Query, topic: str, message: Message) -> None:
        """Answer a query."""
        with query:
            try:
                query.reply(key(self.link.robot, topic), encode(message), encoding=encoding(type(message)))
            except (CodecError, zenoh.ZError) as error:
                self.failed(topic, f"cannot answer {topic}: {error}")

    def refuse(self, query: zenoh.Query, topic: str, why: str) -> None:
        """Answer a query with an error, and count it as dropped."""
        self.counters.drop(f"{topic} refused")
        with query, suppress(zenoh.ZError):  # the asker may be gone
            query.reply_err(why.encode())

    def failed(self, reason: str, text: str) -> None:
        """Count an error and log it, if this reason was not just logged."""
        self.counters.error(text)
        self._limited_log.say(reason, text, time.monotonic())

    def crashed(self, step: str, text: str, error: Exception) -> None:
        """Count and log an exception of the stage's own work, the first of each kind with its traceback."""
        kind = type(error).__name__
        text = f"{text}: {kind}: {error}"
        self.counters.error(text)
        self._limited_log.say(f"{step} {kind}", text, time.monotonic(), error)

    def note(self, kind: str, text: str) -> None:
        """Count an event that lost nothing and log it, if this kind was not just logged."""
        self.counters.event(kind)
        self._limited_log.say(kind, text, time.monotonic())

    def _receive(self, topic: str, handler: Handler[zenoh.Sample]) -> None:
        expected = TOPICS[topic].message
        recording = 0
        for sample in handler:  # until the subscription has ended
            received_ns = time.time_ns()
            try:
                refuse_encoding(str(sample.encoding), expected)
                payload = intact_bytes(sample.payload)
                if payload is None:
                    self.counters.drop(f"{topic} overwritten")
                    continue
                message = decode(payload, expected)
            except CodecError as error:
                self.failed(f"{topic} {str(error).partition(':')[0]}", f"{topic}: message refused: {error}")
                continue
            self.counters.received()
            arrival = self._admission.judge(topic, message.header, time.monotonic())
            if not arrival.refused:
                self._clocks.observe(message.header, received_ns, time.monotonic())
                if isinstance(message, Frame):
                    self._tell_intrinsics(message.intrinsics)
                recording += arrival.restarted
                pushed_out = self._inbox.put(topic, Received(message, received_ns, recording))
                self.counters.drop(f"{topic} busy", pushed_out)

    def _tell_intrinsics(self, camera: CameraIntrinsics) -> None:
        """Report once that the intrinsics hardly fit the images."""
        if camera != self._camera and (text := off_centre(Intrinsics(**camera.model_dump()))):
            self.note("intrinsics off centre", text)
        self._camera = camera

    def _ask(self, topic: str, handler: Handler[zenoh.Query]) -> None:
        for query in handler:  # until the queryable has ended
            # Queries never wait for room in the inbox: the stage's inputs would wait with them.
            if not self._inbox.offer(topic, query):
                self.refuse(query, topic, f"{self.stage} is busy; ask again")

    def _tell(self, topic: str, handler: Handler[zenoh.Query]) -> None:
        """Answer what this process runs on, outside the stage's own thread: the reply also tells the clock's time."""
        for query in handler:  # until the queryable has ended
            header = Header(robot=self.link.robot, seq=0, stamp_ns=time.time_ns(), frame_id=self.stage)
            try:
                told = about(self.numbered(topic, header), self.stage, self.link)
            except (OSError, ValueError) as error:  # such as a disk that does not answer
                self.refuse(query, topic, f"{type(error).__name__}: {error}")
                continue
            self.reply(query, topic, told)

    def _report(self) -> None:
        while not self._gone.wait(self.link.health_interval_s):
            # A stage without waiting inputs may rest. A stage that leaves them waiting hangs, and does not look alive.
            if not self._inbox.waiting or time.monotonic() - self._turned_s < STUCK_S:
                self._publish_health()
                self._heartbeat.beat()

    def _publish_health(self) -> None:
        topic = f"{self.stage}/health"
        now_ns = time.time_ns()
        header = Header(robot=self.link.robot, seq=0, stamp_ns=now_ns, frame_id=self.stage)
        numbered = self.numbered(topic, header)
        self.publish(topic, self.counters.health(numbered, time.monotonic(), process_use(), self._state()))

    def _state(self) -> str:
        """What is wrong now, the stage's own state first."""
        wrong = [self.state] if self.state else []
        count = len(self.alive.processes(self.stage))
        if count > 1:
            wrong.append(f"{count} processes of {self.stage} are running for robot {self.link.robot}: end all but one")
        now_s = time.monotonic()
        wrong += [
            f"more than one process publishes {topic}: end all but one" for topic in self._admission.contested(now_s)
        ]
        for about_what, text in (("stamps", self._admission.stamps(now_s)), ("clocks", self._clocks.notice(now_s))):
            if text:
                self._limited_log.say(about_what, text, now_s)
                wrong.append(text)
        return "; ".join(wrong)

    def _leave(self) -> None:
        self._gone.set()
        self._heartbeat.close()
        self._inbox.close()
        # The last counts, so that collectors miss nothing.
        self._publish_health()


def _reader(target: Callable[[str, Handler[Any]], None], topic: str, handler: Handler[Any]) -> threading.Thread:
    return threading.Thread(target=target, args=(topic, handler), name=topic, daemon=True)
