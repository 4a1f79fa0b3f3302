"""Messages that are longer than any may be take nobody's memory, and hold up nothing."""

import threading
import time
from contextlib import ExitStack

import zenoh

from spot3d.bridge.flow import Flow
from spot3d.dataflow.node import Node
from spot3d.dataflow.process_use import process_use
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import TOPICS, End, Header, encode, encoding, key
from spot3d_schemas.limits import MAX_MESSAGE_BYTES
from waiting import wait_until

TOPIC, ROBOT = "source/end", "long"
HEADER = Header(robot=ROBOT, seq=0, stamp_ns=0, frame_id="camera")
END = encode(End(header=HEADER, frames_sent=1))
TOO_LONG = bytes(MAX_MESSAGE_BYTES + 1)
SAID = f"{TOPIC}: message refused: payload: 67108865 bytes exceed the limit of 67108864 for a message; send less"
BLOCK = zenoh.CongestionControl.BLOCK


def test_a_stage_never_gets_what_is_much_too_long_and_counts_the_rest() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot=ROBOT, connect=(endpoint,), shared_memory=False)
    with (
        open_router((endpoint,)),
        Node("fusion", link, threading.Event(), (TOPIC,)) as node,
        open_session(link) as program,
    ):
        publisher = program.declare_publisher(key(ROBOT, TOPIC), encoding=encoding(End), congestion_control=BLOCK)
        wait_until(lambda: publisher.matching_status.matching)
        for payload in (bytes(MAX_MESSAGE_BYTES + 2**20), TOO_LONG, END):
            publisher.put(payload)
        wait_until(lambda: node.next() is not None)
        health = node.counters.health(HEADER, time.monotonic(), process_use())
        assert (health.received, health.errors, health.last_error) == (1, 1, SAID)


def test_a_bridge_counts_a_message_that_is_too_long_and_goes_on() -> None:
    refused = list[str]()
    there = free_loopback_endpoint()
    link = LinkSettings(robot=ROBOT, connect=(there,))
    with ExitStack() as stack:
        here = stack.enter_context(open_router((free_loopback_endpoint(),)))
        target = stack.enter_context(open_router((there,)))
        heard = stack.enter_context(open_session(link)).declare_subscriber(
            key(ROBOT, TOPIC), zenoh.handlers.FifoChannel(2)
        )
        flow = Flow(TOPICS[TOPIC], here, target, link, lambda _, payload, put: put(payload), refused.append)
        wait_until(lambda: flow._publisher.matching_status.matching)
        flow.follow()
        stack.callback(flow.stop)
        for payload in (TOO_LONG, END):
            here.put(key(ROBOT, TOPIC), payload)
        wait_until(lambda: (sample := heard.try_recv()) is not None and sample.payload.to_bytes() == END)
        assert refused == [SAID]
