"""Forwards over a link: topics that somebody on the other side subscribes to, queries, and liveliness tokens."""

import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress

import zenoh
from zenoh.handlers import Handler, RingChannel

from spot3d.dataflow.endpoints import declare_publisher, has_subscribers, subscribe_newest, waiting
from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import CodecError, Topic, alive_key, key, token_of

Stop = Callable[[], object]
Put = Callable[[bytes], object]
Forward = Callable[[Topic, bytes, Put], None]
"""Sends a message of a topic by `Put`, or skips it."""
Refused = Callable[[str], object]
"""Counts a message that is not forwarded; takes the reason in words."""

_QUERIES_WAITING = 4
"""Maximum number of waiting queries, the newest; the others end without a reply."""
_ANSWER_S = 10.0
"""Maximum time for a reply from the other side."""
_TOKENS = 128
"""Maximum number of mirrored liveliness tokens, that of sixteen stages with some processes each: anybody can declare
tokens."""


class Flow:
    """Forwards one topic from a session on the side of its producer to one on the other side."""

    def __init__(
        self,
        topic: Topic,
        origin: zenoh.Session,
        target: zenoh.Session,
        link: LinkSettings,
        forward: Forward,
        refused: Refused,
    ) -> None:
        self._topic, self._origin, self._link, self._forward, self._refused = topic, origin, link, forward, refused
        self.target, self._publisher = target, declare_publisher(target, topic.name, link)
        self._unsubscribe: Stop | None = None

    def follow(self) -> None:
        """Subscribe while somebody on the other side does, and only then: nothing else should cross the link."""
        wanted = has_subscribers(self._publisher)
        if wanted and self._unsubscribe is None:
            stack = ExitStack()
            where, size = key(self._link.robot, self._topic.name), waiting(self._topic.name, self._link)
            handler = subscribe_newest(self._origin, where, size, stack, self._topic.kept)
            self._unsubscribe = stack.close
            threading.Thread(target=self._pass_on, args=(handler,), daemon=True).start()
        elif not wanted:
            self.stop()

    def stop(self) -> None:
        """Unsubscribe."""
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None

    def withdraw(self) -> None:
        """Undeclare the publisher, which would go on to give late subscribers the last message of a kept topic."""
        undeclare: Stop = self._publisher.undeclare
        undeclare()

    def _pass_on(self, handler: Handler[zenoh.Sample]) -> None:
        while True:
            try:
                payload = intact_bytes(handler.recv().payload)
                if payload is not None:
                    self._forward(self._topic, payload, self._publisher.put)
            except CodecError as error:
                self._refused(f"{self._topic.name}: message refused: {error}")
            except zenoh.ZError:
                return  # the subscription, or the connection to the other side, has ended


class QueryForwarder:
    """Forwards the queries of one topic to the side that answers it, and the replies back."""

    def __init__(self, topic: Topic, asked: zenoh.Session, asking: zenoh.Session, robot: str) -> None:
        self._asked, self._where = asked, key(robot, topic.name)
        channel: RingChannel[zenoh.Query] = RingChannel(_QUERIES_WAITING)
        queryable = asking.declare_queryable(self._where, channel, complete=True)
        self.stop: Stop = queryable.undeclare
        threading.Thread(target=self._ask, args=(queryable.handler,), daemon=True).start()

    def _ask(self, handler: Handler[zenoh.Query]) -> None:
        for query in handler:  # until the queryable is undeclared
            # A query that cannot be forwarded ends without a reply.
            with query, suppress(zenoh.ZError):
                for reply in self._asked.get(query.selector, payload=query.payload, timeout=_ANSWER_S):
                    if reply.ok is not None:
                        query.reply(self._where, reply.ok.payload, encoding=reply.ok.encoding)
                    elif reply.err is not None:
                        query.reply_err(reply.err.payload, encoding=reply.err.encoding)


class TokenMirror:
    """Mirrors the liveliness tokens of some stages, and of their processes, from one side to the other."""

    def __init__(
        self, origin: zenoh.Session, target: zenoh.Session, robot: str, belongs: Callable[[str], bool]
    ) -> None:
        self._target, self._belongs = target, belongs
        self._shown: dict[str, Stop] = {}
        self._closed = False
        self._changing = threading.Lock()
        subscriber = origin.liveliness().declare_subscriber(f"{alive_key(robot, '*')}/**", self._change, history=True)
        self._unsubscribe: Stop = subscriber.undeclare

    def stop(self) -> None:
        """Withdraw all mirrored tokens."""
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
            if there and not self._closed and where not in self._shown and len(self._shown) < _TOKENS:
                self._shown[where] = self._target.liveliness().declare_token(where).undeclare
            elif not there and where in self._shown:
                self._shown.pop(where)()
