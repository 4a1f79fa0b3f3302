"""The loop of a stage, which passes each input to its handler; a handler may fail."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import zenoh

from spot3d.dataflow.node import Node, Received
from spot3d_schemas import TOPICS, Message

M = TypeVar("M", bound=Message)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class On(Generic[M]):
    """A stage's handler for the messages of one topic, which are of one type."""

    topic: str
    message: type[M]
    work: Callable[[Received[M]], None]

    def __post_init__(self) -> None:
        if TOPICS[self.topic].message is not self.message:
            raise TypeError(f"{self.topic} has messages of type {TOPICS[self.topic].message.__name__}")


@dataclass(frozen=True, slots=True)
class OnQuery:
    """A stage's handler for the queries of one topic."""

    topic: str
    work: Callable[[zenoh.Query], None]


def attempted(node: Node, step: str, text: str, work: Callable[[], T]) -> T | None:
    """A core's result for one frame, whose time is counted; None if it fails, which is counted and logged."""
    start_s = time.perf_counter()
    try:
        done = work()
    except Exception as error:
        node.crashed(step, text, error)
        return None
    node.counters.step(time.perf_counter() - start_s)
    return done


def serve(node: Node, *handlers: On[Any] | OnQuery, between: Callable[[], None] = lambda: None) -> None:
    """Hand each input to its handler, one at a time, until the node's stop is set.

    between: called after each input, and several times a second while none comes.
    """
    works = {handler.topic: handler.work for handler in handlers}
    while not node.stop.is_set():
        item = node.next()
        if item is not None:
            topic, given = item
            works[topic](given)
        between()
