"""The one table of topics: who says what, where, how often, and whether it may be dropped."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from spot3d_schemas.messages import (
    End,
    Frame,
    Health,
    Heat,
    MapPoints,
    Message,
    Objects,
    Pose,
    Progress,
    Proposals,
    Segments,
)
from spot3d_schemas.names import checked_name

STAGES = ("source", "pose", "proposals", "heatmap", "segments", "fusion")
"""The processes of the dataflow, in its order."""

Delivery = Literal["live", "lossless", "by run"]
"""live: the latest wins. lossless: nothing is dropped. by run: live for cameras, lossless for recordings."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One row: a published stream, or a query that the producer answers with `message`."""

    name: str
    message: type[Message]
    rate_hz: float
    """Nominal rate for a 30 Hz camera; 0 for queries."""
    delivery: Delivery
    kind: Literal["pub", "query"] = "pub"

    @property
    def producer(self) -> str:
        """The stage that publishes the topic or answers the query."""
        return self.name.partition("/")[0]

    @property
    def key_template(self) -> str:
        """The key expression with {robot} for the robot's name."""
        return f"spot3d/{{robot}}/{self.name}"


_ROWS = (
    Topic("source/frame", Frame, 30.0, "by run"),
    Topic("source/end", End, 2.0, "lossless"),
    Topic("pose/pose", Pose, 30.0, "lossless"),
    Topic("proposals/boxes", Proposals, 30.0, "by run"),
    Topic("heatmap/heat", Heat, 30.0, "by run"),
    Topic("segments/segments", Segments, 30.0, "by run"),
    Topic("fusion/objects", Objects, 2.0, "lossless"),
    Topic("fusion/progress", Progress, 30.0, "lossless"),
    *(Topic(f"{stage}/health", Health, 1.0, "live") for stage in STAGES),
    Topic("fusion/map", MapPoints, 0.0, "lossless", "query"),
    Topic("fusion/reset", Progress, 0.0, "lossless", "query"),
)

TOPICS = MappingProxyType({topic.name: topic for topic in _ROWS})
"""Every topic by its name, `<stage>/<topic>`."""


def key(robot: str, topic: str) -> str:
    """The key expression of one robot's topic.

    Raises ValueError where `robot` cannot be one chunk of a key, KeyError where there is no such topic.
    """
    return TOPICS[topic].key_template.format(robot=checked_name(robot))


def alive_key(robot: str, stage: str) -> str:
    """The key of the liveliness token that a stage's process holds; `*` for any robot or stage."""
    return f"spot3d/{robot if robot == '*' else checked_name(robot)}/{stage}/alive"


def fleet_key(topic: str) -> str:
    """The key expression that matches a topic of every robot. Raises KeyError for an unknown topic."""
    return TOPICS[topic].key_template.format(robot="*")


def process_key(robot: str, stage: str, sender: str) -> str:
    """The key of the liveliness token of one process of a stage, the `sender` of its messages; `*` for any."""
    name = sender if sender == "*" else checked_name(sender)
    return f"{alive_key(robot, stage)}/{name}"
