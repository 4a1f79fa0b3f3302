"""The dashboard's connection: receives the robots' messages without ever making one wait."""

import logging
import queue
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import zenoh
from zenoh.handlers import Handler, RingChannel

from spot3d.dashboard.health import HEARD
from spot3d.dataflow.alive import stages_by_robot
from spot3d.dataflow.endpoints import end_subscription, subscribe_newest
from spot3d.dataflow.payload import intact_bytes, refusal
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d_schemas import TOPICS, CodecError, MapChanges, Message, decode, fleet_key, key, robot_of
from spot3d_schemas.limits import MAX_MAP_CHANGES

log = logging.getLogger(__name__)

_FLEET = (*(f"{stage}/health" for stage in HEARD), "fusion/objects")
"""Small topics, subscribed to for every robot."""
_SHOWN = ("source/preview", "heatmap/preview", "pose/pose", "fusion/progress")
"""Topics subscribed to only for robots that are shown."""
_WAITING = {"fusion/objects": 8, "pose/pose": 64, "fusion/progress": 64, "source/preview": 1, "heatmap/preview": 1}
_HEALTHS_WAITING = 64
_POLL_S = 1.0
_ANSWER_S = 5.0
_POINT_BYTES = 24
_PRIORITY = zenoh.Priority.DATA_LOW
_NAME = b"the dashboard"
"""Sent with a query: fusion reports by whom it was reset."""
ROBOTS_MAX = 16
"""Most robots that are shown; one that is gone makes room, and the page says if more are alive."""

Heard = tuple[str, str, Message]
"""Robot, topic, message."""


@dataclass(frozen=True, slots=True)
class Interest:
    """What to subscribe to besides every robot's health and objects: poses of `robots`, and what is set."""

    robots: frozenset[str] = frozenset()
    images: bool = False
    heat: bool = False
    maps: bool = False

    def pictures(self) -> tuple[tuple[str, bool], ...]:
        """The topics of images, and whether they are wanted."""
        return ("source/preview", self.images), ("heatmap/preview", self.images and self.heat)


class Link:
    """A connection to a router while its `with` block lasts, opened and reopened in the background."""

    def __init__(self, settings: LinkSettings, map_rate: float) -> None:
        self._settings = settings
        self._map_rate = map_rate
        self._limited_log = RateLimitedLog(log)
        self._stop = threading.Event()
        self._interest = Interest()
        self._cursors: dict[str, tuple[int, int]] = {}
        self._answers: queue.Queue[Heard] = queue.Queue(ROBOTS_MAX)
        self._lock = threading.Lock()
        self._fleet: dict[str, Handler[zenoh.Sample]] = {}
        self._subscribers: dict[tuple[str, str], zenoh.Subscriber[Handler[zenoh.Sample]]] = {}
        self._session: zenoh.Session | None = None
        self.alive: dict[str, frozenset[str]] = {}
        self.connected = False
        self.failed: OSError | None = None
        """Why it cannot listen at its address; an unreachable router is waited for instead."""
        self._settled = threading.Event()
        self._pause_s = 0.1
        self._thread = threading.Thread(target=self._work, name="link", daemon=True)

    def __enter__(self) -> "Link":
        """Start to connect. Raises OSError where it cannot listen at its address."""
        self._thread.start()
        if self._settings.mode != "client":
            self._settled.wait(_ANSWER_S)
            if self.failed is not None:
                raise self.failed
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(_ANSWER_S + 2)

    def follow(self, interest: Interest) -> None:
        """Subscribe to these topics from now on, and to no other large ones."""
        if interest != self._interest:
            with self._lock:
                self._interest = interest
                self._listen()

    def forget(self, robot: str) -> None:
        """Ask for the robot's whole map if it comes back."""
        self._cursors.pop(robot, None)

    def drain(self) -> Iterator[Heard]:
        """All valid messages since the last call."""
        with self._lock:
            handlers = [*self._fleet.items(), *((topic, ear.handler) for (_, topic), ear in self._subscribers.items())]
        for topic, handler in handlers:
            while (sample := _received(handler)) is not None:
                message = self._decoded(sample, topic)
                robot = robot_of(str(sample.key_expr))
                if message is not None and robot is not None:
                    yield robot, topic, message
        while not self._answers.empty():
            yield self._answers.get_nowait()

    def ask(self, robot: str, topic: str, timeout_s: float = _ANSWER_S) -> Message | str | None:
        """The answer of a robot's stage to a query; why it refuses, for people; None without an answer."""
        session = self._session
        return None if session is None else self._answer(session, key(robot, topic), topic, timeout_s)

    def _work(self) -> None:
        try:
            with open_session(self._settings, self._stop) as session, ExitStack() as stack:
                with self._lock:
                    for topic in _FLEET:
                        size = _WAITING.get(topic, _HEALTHS_WAITING)
                        ear = subscribe_newest(session, fleet_key(topic), size, stack, TOPICS[topic].kept)
                        self._fleet[topic] = ear
                    self._session = session
                    self._listen()
                self._settled.set()
                stack.callback(self._hush)
                while not self._stop.wait(self._pause_s):
                    try:
                        self._poll(session)
                    except zenoh.ZError as error:  # a session that is connecting again, say
                        log.warning("cannot tell which robots are alive: %s", error)
                        self._pause_s = _POLL_S
        except (StoppedError, zenoh.ZError) as error:
            if not self._stop.is_set():
                log.error("no connection: %s", error)
        except OSError as error:
            self.failed = error
        finally:
            self._settled.set()

    def _poll(self, session: zenoh.Session) -> None:
        """Ask which stages are alive, and for the changes of the shown maps."""
        client = self._settings.mode == "client"
        self.connected = bool(session.info.routers_zid()) or not client
        self.alive = stages_by_robot(session, _ANSWER_S)
        interest = self._interest
        shown = sorted(interest.robots) if interest.maps else ()
        asked = [robot for robot in shown if "fusion" in self.alive.get(robot, ())]
        behind = 0
        start_s = time.monotonic()
        for robot in asked:
            generation, since = self._cursors.get(robot, (0, 0))
            # Over a slow link an answer takes time: the next one is not asked for before it is here.
            where = f"{key(robot, 'fusion/changes')}?generation={generation};since={since};limit={MAX_MAP_CHANGES}"
            answer = self._answer(session, where, "fusion/changes", _ANSWER_S)
            if isinstance(answer, MapChanges) and not self._answers.full():
                self._answers.put((robot, "fusion/changes", answer))
                self._cursors[robot] = (answer.generation, answer.cursor)
                behind = max(behind, answer.behind)
        full_s = MAX_MAP_CHANGES * _POINT_BYTES / (1e6 * self._map_rate)
        period_s = full_s if behind else _POLL_S
        self._pause_s = max(0.05, period_s - (time.monotonic() - start_s))

    def _listen(self) -> None:
        """Subscribe to the topics that are shown, and end the other subscriptions. Call it with the lock held."""
        if self._session is None:
            return
        left_out = {topic for topic, there in self._interest.pictures() if not there}
        wanted = {(robot, topic) for robot in self._interest.robots for topic in _SHOWN if topic not in left_out}
        for place in self._subscribers.keys() - wanted:
            end_subscription(self._subscribers.pop(place))
        for robot, topic in wanted - self._subscribers.keys():
            channel: RingChannel[zenoh.Sample] = RingChannel(_WAITING[topic])
            self._subscribers[robot, topic] = self._session.declare_subscriber(key(robot, topic), channel)

    def _hush(self) -> None:
        with self._lock:
            self._session, self.connected, self.alive = None, False, {}
            for subscriber in self._subscribers.values():
                end_subscription(subscriber)
            self._subscribers, self._fleet = {}, {}

    def _decoded(self, sample: zenoh.Sample, topic: str) -> Message | None:
        """The message; None where it is invalid, which must not stop the dashboard."""
        try:
            payload = intact_bytes(sample.payload)
            return None if payload is None else decode(payload, TOPICS[topic].message)
        except CodecError as error:
            where = str(sample.key_expr)
            self._limited_log.say(where, f"{where}: message refused: {error}", time.monotonic())
            return None

    def _answer(self, session: zenoh.Session, selector: str, topic: str, timeout_s: float) -> Message | str | None:
        said = ""
        try:
            for reply in session.get(selector, timeout=timeout_s, priority=_PRIORITY, payload=_NAME):
                if reply.ok is not None:
                    return self._decoded(reply.ok, topic)
                said = said or refusal(reply)
        except zenoh.ZError as error:
            log.warning("%s: no answer: %s", selector, error)
        return said or None


def _received(handler: "Handler[zenoh.Sample]") -> zenoh.Sample | None:
    try:
        return handler.try_recv()
    except zenoh.ZError:
        return None  # the subscription has ended
