"""The one table of topics: producer, key, message, rate, and whether messages may be dropped."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

from spot3d_schemas.image_messages import Frame, Heat, Preview, Proposals, Segments
from spot3d_schemas.message import Message
from spot3d_schemas.names import checked_name, is_name
from spot3d_schemas.state_messages import About, End, Health, Progress
from spot3d_schemas.world_messages import MapChanges, MapPoints, Objects, Pose

STAGES = ("source", "pose", "proposals", "heatmap", "segments", "fusion")
"""The processes of the dataflow, in its order."""

BRIDGE = "bridge"
"""The process that joins two devices over a thin link, where there is one."""

Delivery = Literal["live", "lossless", "by run"]
"""live: the latest wins. lossless: nothing is dropped. by run: live for cameras, lossless for recordings."""


Congestion = Literal["block", "block first", "drop"]
"""What a sender does when the network is full. block first: it waits with one message, and drops those that come
meanwhile."""

Priority = Literal["interactive high", "interactive low", "data high", "data", "data low"]
"""Which message goes first where several wait; the names are Zenoh's."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One row: a published stream, or a query that the producer answers with `message`."""

    name: str
    message: type[Message]
    rate_hz: float
    """Nominal rate for a 30 Hz camera; 0 for queries."""
    delivery: Delivery
    kind: Literal["pub", "query"] = "pub"
    congestion: Congestion = "block"
    priority: Priority = "data"
    express: bool = False
    """Sent at once, not gathered with others into one packet."""
    newest: int = 0
    """Maximum number of messages queued for a live reader, the newest; 0: all, as they are small and few."""
    kept: bool = False
    """A late subscriber still gets the last one."""

    @property
    def producer(self) -> str:
        """The stage (or the bridge) that publishes the topic or answers the query."""
        return self.name.partition("/")[0]

    @property
    def key_template(self) -> str:
        """The key expression with {robot} for the robot's name."""
        return f"spot3d/{{robot}}/{self.name}"


_ROWS = (
    Topic("source/frame", Frame, 30.0, "by run", congestion="block first", newest=3),
    Topic("source/preview", Preview, 5.0, "live", congestion="drop", priority="data low", newest=1),
    Topic("source/end", End, 2.0, "lossless", priority="data low"),
    Topic("pose/pose", Pose, 30.0, "lossless", priority="interactive high", express=True),
    Topic("proposals/boxes", Proposals, 30.0, "by run", congestion="block first", priority="data high", newest=8),
    # Over a thin link heat must not delay poses and objects. Fusion is faster than any camera, and catches up with
    # queued messages after a short stall.
    Topic("heatmap/heat", Heat, 30.0, "by run", congestion="block first", priority="data low", newest=4),
    Topic("heatmap/preview", Preview, 5.0, "live", congestion="drop", priority="data low", newest=1),
    # Most say that a frame is no keyframe, and must not push out one that is: a second's worth is queued. No frame
    # waits for the stage in a live run, so the stage itself may wait.
    Topic("segments/segments", Segments, 30.0, "by run", newest=32),
    Topic("fusion/objects", Objects, 2.0, "lossless", priority="data high", kept=True),
    Topic("fusion/progress", Progress, 30.0, "lossless", priority="interactive high", express=True),
    *(
        Topic(f"{stage}/health", Health, 1.0, "live", congestion="drop", priority="interactive low", newest=1)
        for stage in (*STAGES, BRIDGE)
    ),
    *(Topic(f"{stage}/about", About, 0.0, "lossless", "query") for stage in STAGES),
    Topic("fusion/map", MapPoints, 0.0, "lossless", "query"),
    Topic("fusion/changes", MapChanges, 0.0, "lossless", "query"),
    Topic("fusion/reset", Progress, 0.0, "lossless", "query"),
)

TOPICS = MappingProxyType({topic.name: topic for topic in _ROWS})
"""Every topic by its name, `<stage>/<topic>`."""

MESSAGES: dict[str, type[Message]] = {topic.message.__name__: topic.message for topic in _ROWS}
"""Every message by its short name."""


def key(robot: str, topic: str) -> str:
    """The key expression of one robot's topic.

    Raises ValueError where `robot` cannot be one chunk of a key, KeyError where there is no such topic.
    """
    return TOPICS[topic].key_template.format(robot=checked_name(robot))


def alive_key(robot: str, stage: str) -> str:
    """The key of the liveliness token that a stage's process holds; `*` for any robot or stage."""
    return f"spot3d/{robot if robot == '*' else checked_name(robot)}/{stage}/alive"


class Token(NamedTuple):
    """What a liveliness token says is alive: a robot's stage, or one process of it, the `sender` of its messages."""

    robot: str
    stage: str
    sender: str | None


def token_of(key_expr: str) -> Token | None:
    """The token with this key; None if it is none of ours: anybody may declare any, even with wildcards."""
    parts = key_expr.split("/")
    if len(parts) not in (4, 5) or (parts[0], parts[3]) != ("spot3d", "alive"):
        return None
    names = parts[1], parts[2], *parts[4:]
    if not all(map(is_name, names)):
        return None
    return Token(parts[1], parts[2], parts[4] if len(parts) == 5 else None)


def robot_of(key_expr: str) -> str | None:
    """The robot of a message with this key; None if the key names none, as with a wildcard."""
    parts = key_expr.split("/")
    return parts[1] if len(parts) > 1 and is_name(parts[1]) else None


def fleet_key(topic: str) -> str:
    """The key expression that matches a topic of every robot. Raises KeyError for an unknown topic."""
    return TOPICS[topic].key_template.format(robot="*")


def process_key(robot: str, stage: str, sender: str) -> str:
    """The key of the liveliness token of one process of a stage, the `sender` of its messages; `*` for any."""
    name = sender if sender == "*" else checked_name(sender)
    return f"{alive_key(robot, stage)}/{name}"
