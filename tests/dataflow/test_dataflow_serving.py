"""The loop of a stage."""

import threading

import pytest

from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.serving import On, serve
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import End, Frame, Header


def test_each_input_goes_to_its_handler_until_the_stop() -> None:
    stop, heard, rounds = threading.Event(), list[int](), list[int]()
    node = Node("fusion", LinkSettings(), stop, inputs=("source/end",))
    for sent in (1, 2):
        end = End(header=Header(robot="robot", seq=0, stamp_ns=0, frame_id="camera"), frames_sent=sent)
        node._inbox.put("source/end", Received(end, 0))

    def take(given: Received[End]) -> None:
        heard.append(given.message.frames_sent)

    def count() -> None:
        rounds.append(1)
        if len(rounds) == 3:
            stop.set()

    serve(node, On("source/end", End, take), between=count)
    assert (heard, len(rounds)) == ([1, 2], 3), "the third time nothing came"


def test_a_handler_is_of_the_type_that_its_topic_has() -> None:
    def take(given: Received[Frame]) -> None: ...

    with pytest.raises(TypeError, match="source/end has messages of type End"):
        On("source/end", Frame, take)
