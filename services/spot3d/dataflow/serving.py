"""The loop of a stage: each input goes to the function that handles it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import zenoh

from spot3d.dataflow.node import Node, Received
from spot3d_schemas import TOPICS, Message

M = TypeVar("M", bound=Message)


@dataclass(frozen=True, slots=True)
class On(Generic[M]):
    """What a stage does with the messages of one topic, which are of one type."""

    topic: str
    message: type[M]
    work: Callable[[Received[M]], None]

    def __post_init__(self) -> None:
        if TOPICS[self.topic].message is not self.message:
            raise TypeError(f"{self.topic} has messages of type {TOPICS[self.topic].message.__name__}")


@dataclass(frozen=True, slots=True)
class OnQuery:
    """What a stage does with the queries of one topic."""

    topic: str
    work: Callable[[zenoh.Query], None]


def serve(node: Node, *handlers: On[Any] | OnQuery, between: Callable[[], None] = lambda: None) -> None:
    """Hand each input to its handler, one at a time, until the node's stop is set.

    between: called after each, and several times a second where nothing comes.
    """
    works = {handler.topic: handler.work for handler in handlers}
    while not node.stop.is_set():
        item = node.next()
        if item is not None:
            topic, given = item
            works[topic](given)
        between()
