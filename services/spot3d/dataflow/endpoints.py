"""How each topic travels: congestion, priority and how much waits at a subscriber."""

from dataclasses import dataclass

import zenoh
from zenoh import CongestionControl, Priority
from zenoh.ext import AdvancedPublisher, CacheConfig, declare_advanced_publisher
from zenoh.handlers import FifoChannel, Handler, RingChannel

from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import TOPICS, encoding, key

_SMALL_WAITING = 64
"""Most small messages that wait at a subscriber; poses and progress are never dropped."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How a topic is sent, and how many messages wait for a live reader (0: all that are small)."""

    congestion: CongestionControl
    priority: Priority
    express: bool = False
    newest: int = 0


_QUALITIES = {
    "source/frame": Quality(CongestionControl.BLOCK_FIRST, Priority.DATA, newest=3),
    "source/end": Quality(CongestionControl.BLOCK, Priority.DATA_LOW),
    "pose/pose": Quality(CongestionControl.BLOCK, Priority.INTERACTIVE_HIGH, express=True),
    "proposals/boxes": Quality(CongestionControl.BLOCK_FIRST, Priority.DATA_HIGH, newest=8),
    # Over a thin link heat must not delay poses and objects. Fusion is faster than any camera, and catches up with what
    # has waited while it was held up for a moment.
    "heatmap/heat": Quality(CongestionControl.BLOCK_FIRST, Priority.DATA_LOW, newest=4),
    # Most say that a frame is no keyframe, and must not push out one that is: a second's worth waits. No frame waits
    # for the stage in a live run, so that it may wait itself.
    "segments/segments": Quality(CongestionControl.BLOCK, Priority.DATA, newest=32),
    "fusion/objects": Quality(CongestionControl.BLOCK, Priority.DATA_HIGH),
    "fusion/progress": Quality(CongestionControl.BLOCK, Priority.INTERACTIVE_HIGH, express=True),
}
_HEALTH = Quality(CongestionControl.DROP, Priority.INTERACTIVE_LOW, newest=1)
_PREVIEW = Quality(CongestionControl.DROP, Priority.DATA_LOW, newest=1)
_FOR_PEOPLE = {"health": _HEALTH, "preview": _PREVIEW}
"""What no stage waits for, by the last part of the topic's name."""


def quality(topic: str) -> Quality:
    """How a published topic travels. Raises KeyError for queries and unknown topics."""
    return _FOR_PEOPLE.get(topic.partition("/")[2]) or _QUALITIES[topic]


def waiting(topic: str, link: LinkSettings) -> int:
    """Most messages of a topic that wait at a subscriber, in Zenoh's channel and again in the inbox."""
    newest = quality(topic).newest
    if link.delivery == "lossless" and newest:
        return link.in_flight + 2
    return newest or _SMALL_WAITING


def keeps_newest(topic: str, link: LinkSettings) -> bool:
    """Whether a full inbox drops the oldest message rather than make the sender wait."""
    return link.delivery == "live" and quality(topic).newest > 0


def declare_publisher(session: zenoh.Session, topic: str, link: LinkSettings) -> zenoh.Publisher | AdvancedPublisher:
    """The publisher of a topic; objects are kept for those who come late."""
    how = quality(topic)
    congestion = how.congestion
    if link.delivery == "lossless" and congestion == CongestionControl.BLOCK_FIRST:
        congestion = CongestionControl.BLOCK
    where, what = key(link.robot, topic), encoding(TOPICS[topic].message)
    if topic == "fusion/objects":
        return declare_advanced_publisher(
            session,
            where,
            encoding=what,
            congestion_control=congestion,
            priority=how.priority,
            cache=CacheConfig(1),
            publisher_detection=True,
        )
    return session.declare_publisher(
        where, encoding=what, congestion_control=congestion, priority=how.priority, express=how.express
    )


def declare_subscriber(
    session: zenoh.Session, topic: str, link: LinkSettings
) -> zenoh.Subscriber[Handler[zenoh.Sample]]:
    """The subscriber of a topic with a channel of explicit size: Zenoh's own would hold 256 frames."""
    size = waiting(topic, link)
    channel: RingChannel[zenoh.Sample] | FifoChannel[zenoh.Sample]
    channel = RingChannel(size) if keeps_newest(topic, link) else FifoChannel(size)
    return session.declare_subscriber(key(link.robot, topic), channel)
