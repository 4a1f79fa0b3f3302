"""What goes from one side of a link to the other: topics that somebody there listens to, questions, signs of life."""

import threading
from collections.abc import Callable
from contextlib import suppress

import zenoh
from zenoh.handlers import Handler, RingChannel

from spot3d.dataflow.endpoints import declare_publisher, has_subscribers, waiting
from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Topic, alive_key, key, token_of

Stop = Callable[[], object]
Put = Callable[[bytes], object]
Forward = Callable[[Topic, bytes, Put], None]
"""Sends a message of a topic by `Put`, or does not."""

_QUERIES_WAITING = 4
"""Of those that wait for their turn the newest stay; whoever asked the others hears that no answer comes."""
_ANSWER_S = 10.0
"""Longest that an answer takes to come from the other side."""


class Flow:
    """One topic, from a session on the side of its producer to one on the other side."""

    def __init__(
        self, topic: Topic, origin: zenoh.Session, target: zenoh.Session, link: LinkSettings, forward: Forward
    ) -> None:
        self._topic, self._origin, self._link, self._forward = topic, origin, link, forward
        self._publisher = declare_publisher(target, topic.name, link)
        self._unsubscribe: Stop | None = None

    def follow(self) -> None:
        """Subscribe where somebody listens on the other side, and only then: nothing else is to cross the link."""
        wanted = has_subscribers(self._publisher)
        if wanted and self._unsubscribe is None:
            # Never a FIFO: while one is full, nothing else of the session is received.
            channel: RingChannel[zenoh.Sample] = RingChannel(waiting(self._topic.name, self._link))
            where = key(self._link.robot, self._topic.name)
            subscriber = self._origin.declare_subscriber(where, channel)
            self._unsubscribe = subscriber.undeclare
            threading.Thread(target=self._pass_on, args=(subscriber.handler,), daemon=True).start()
        elif not wanted:
            self.stop()

    def stop(self) -> None:
        """Unsubscribe."""
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None

    def _pass_on(self, handler: Handler[zenoh.Sample]) -> None:
        while True:
            try:
                payload = intact_bytes(handler.recv().payload)
                if payload is not None:
                    self._forward(self._topic, payload, self._publisher.put)
            except zenoh.ZError:
                return  # the subscription, or the connection to the other side, has ended


class Questions:
    """Asks a query topic of the side that answers it, for whoever asks on the other one."""

    def __init__(self, topic: Topic, asked: zenoh.Session, asking: zenoh.Session, robot: str) -> None:
        self._asked, self._where = asked, key(robot, topic.name)
        channel: RingChannel[zenoh.Query] = RingChannel(_QUERIES_WAITING)
        queryable = asking.declare_queryable(self._where, channel, complete=True)
        self.stop: Stop = queryable.undeclare
        threading.Thread(target=self._ask, args=(queryable.handler,), daemon=True).start()

    def _ask(self, handler: Handler[zenoh.Query]) -> None:
        for query in handler:  # until nobody is asked any more
            # A question that cannot be passed on ends without an answer.
            with query, suppress(zenoh.ZError):
                for reply in self._asked.get(query.selector, payload=query.payload, timeout=_ANSWER_S):
                    if reply.ok is not None:
                        query.reply(self._where, reply.ok.payload, encoding=reply.ok.encoding)


class Signs:
    """The signs of life of some stages on one side, shown on the other."""

    def __init__(
        self, origin: zenoh.Session, target: zenoh.Session, robot: str, belongs: Callable[[str], bool]
    ) -> None:
        self._target, self._belongs = target, belongs
        self._shown: dict[str, Stop] = {}
        self._closed = False
        self._changing = threading.Lock()
        subscriber = origin.liveliness().declare_subscriber(alive_key(robot, "*"), self._change, history=True)
        self._unsubscribe: Stop = subscriber.undeclare

    def stop(self) -> None:
        """Show none any more."""
        self._unsubscribe()
        with self._changing:
            self._closed = True
            for hide in self._shown.values():
                hide()
            self._shown.clear()

    def _change(self, sample: zenoh.Sample) -> None:
        where, there = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        token = token_of(where)
        if token is None or not self._belongs(token.stage):
            return
        with self._changing:
            if there and not self._closed and where not in self._shown:
                self._shown[where] = self._target.liveliness().declare_token(where).undeclare
            elif not there and where in self._shown:
                self._shown.pop(where)()
