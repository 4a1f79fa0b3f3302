"""Declares publishers and subscribers by the table of topics: congestion control, priority and queue sizes."""

from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

import zenoh
from zenoh import CongestionControl, Priority
from zenoh.ext import (
    AdvancedPublisher,
    CacheConfig,
    HistoryConfig,
    MissDetectionConfig,
    declare_advanced_publisher,
    declare_advanced_subscriber,
)
from zenoh.handlers import FifoChannel, Handler, RingChannel

from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import TOPICS, encoding, key

_SMALL_WAITING = 64
"""Maximum number of small messages queued at a subscriber; poses and progress are never dropped."""


_CONGESTION = {
    "block": CongestionControl.BLOCK,
    "block first": CongestionControl.BLOCK_FIRST,
    "drop": CongestionControl.DROP,
}
_PRIORITY = {
    "interactive high": Priority.INTERACTIVE_HIGH,
    "interactive low": Priority.INTERACTIVE_LOW,
    "data high": Priority.DATA_HIGH,
    "data": Priority.DATA,
    "data low": Priority.DATA_LOW,
}


def waiting(topic: str, link: LinkSettings) -> int:
    """Queue size of a topic at a subscriber, for Zenoh's channel and again for the inbox."""
    newest = TOPICS[topic].newest
    if link.delivery == "lossless" and newest:
        return link.in_flight + 2
    return newest or _SMALL_WAITING


def keeps_newest(topic: str, link: LinkSettings) -> bool:
    """Whether a full inbox drops the oldest message rather than make the sender wait."""
    return link.delivery == "live" and TOPICS[topic].newest > 0


def declare_publisher(session: zenoh.Session, topic: str, link: LinkSettings) -> zenoh.Publisher | AdvancedPublisher:
    """The publisher of a topic. Late subscribers still get the last message of a kept topic."""
    row = TOPICS[topic]
    congestion, priority = _CONGESTION[row.congestion], _PRIORITY[row.priority]
    if link.delivery == "lossless" and congestion == CongestionControl.BLOCK_FIRST:
        congestion = CongestionControl.BLOCK
    where, what = key(link.robot, topic), encoding(row.message)
    if row.kept:
        return declare_advanced_publisher(
            session,
            where,
            encoding=what,
            congestion_control=congestion,
            priority=priority,
            cache=CacheConfig(1),
            publisher_detection=True,
            # Samples are numbered, not timestamped: clocks differ.
            sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
        )
    return session.declare_publisher(
        where, encoding=what, congestion_control=congestion, priority=priority, express=row.express
    )


def has_subscribers(publisher: zenoh.Publisher | AdvancedPublisher) -> bool:
    """Whether anybody subscribes; always true for kept topics, of which that is not known."""
    if not isinstance(publisher, zenoh.Publisher):
        return True
    status: Any = publisher.matching_status  # Zenoh's stubs state its type wrongly
    return bool(status.matching)


def declare_subscriber(
    session: zenoh.Session, topic: str, link: LinkSettings
) -> zenoh.Subscriber[Handler[zenoh.Sample]]:
    """The subscriber of a topic with a channel of explicit size: Zenoh's own would hold 256 frames."""
    size = waiting(topic, link)
    channel: RingChannel[zenoh.Sample] | FifoChannel[zenoh.Sample]
    channel = RingChannel(size) if keeps_newest(topic, link) else FifoChannel(size)
    return session.declare_subscriber(key(link.robot, topic), channel)


def subscribe_newest(
    session: zenoh.Session, where: str, size: int, stack: ExitStack, kept: bool = False
) -> Handler[zenoh.Sample]:
    """The newest `size` messages from now on until the stack closes; of a kept topic the last one from before as well.

    Never a FIFO: while one is full, the session receives nothing else.
    """
    channel: RingChannel[zenoh.Sample] = RingChannel(size)
    if not kept:
        return stack.enter_context(session.declare_subscriber(where, channel)).handler
    history = HistoryConfig(detect_late_publishers=True, max_samples=1)
    late = declare_advanced_subscriber(session, where, channel, history=history)
    undeclare: Callable[[], object] = late.undeclare
    stack.callback(undeclare)
    return late.handler


def end_subscription(subscriber: "zenoh.Subscriber[Any]") -> None:
    """Undeclare a subscriber."""
    undeclare: Callable[[], object] = subscriber.undeclare
    with suppress(zenoh.ZError):  # its session may be closed, or two threads do this
        undeclare()
