"""Cost of a Frame message: the codec against a copy of its bytes, sending it against a bare Zenoh hop."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import zenoh
from zenoh.handlers import FifoChannel

from spot3d.bench.material import Material
from spot3d.bench.timing import MEASURED, Timed, alternate, measured_row
from spot3d.dataflow.conversion import frame_message
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.evaluate.table import Table
from spot3d_schemas import Frame, Header, decode, encode

REPEATS, ROUNDS = 10, 5
_KEY = "spot3d/bench/hop"
_MATCHING_S = 5.0
"""Longest wait for the two sessions to find each other."""


def messages_table(materials: Sequence[Material], say: Callable[[str], None]) -> Table:
    """Times of encoding, decoding and sending a Frame of each material."""
    table = Table("messages", "A frame's message", MEASURED)
    for material in materials:
        say(f"messages: {material.data}, {material.size} ...")
        frame = material.frames[0]
        message = frame_message(Header(robot="robot", seq=0, stamp_ns=frame.stamp_ns, frame_id="camera"), frame)
        payload = encode(message)
        copy = partial(bytearray, payload)
        with loopback() as hop:
            calls: list[Callable[[], object]] = [
                partial(encode, message),
                partial(decode, payload, Frame),
                partial(_out_and_in, message),
                partial(_sent, message, hop),
                partial(hop, payload),
                copy,
            ]
            out, into, both, sent, bare, copied = alternate([Timed(call, REPEATS) for call in calls], ROUNDS)
        where = (material.data, material.size)
        name = f"a copy of its {len(payload) / 1e6:.2f} MB"
        for step, timing in (("Frame: encode", out), ("Frame: decode", into), ("Frame: encode + decode", both)):
            table.add(*measured_row(*where, step, timing, name, copied, copied))
        table.add(*measured_row(*where, "Frame: encode, hop, decode", sent, "a bare hop of its bytes", bare, copied))
    table.notes.append(
        "A hop: from one session through a router to another, on loopback, all in this process, until the bytes are "
        "Python's. CPU time counts Zenoh's own threads."
    )
    return table


@contextmanager
def loopback() -> Iterator[Callable[[bytes], bytes]]:
    """A function that sends bytes from one client of a router to another and returns what arrives there."""
    endpoint = free_loopback_endpoint()
    link = LinkSettings(connect=(endpoint,))
    with open_router((endpoint,)), open_session(link) as near, open_session(link) as far:
        publisher = near.declare_publisher(_KEY, congestion_control=zenoh.CongestionControl.BLOCK)
        subscriber = far.declare_subscriber(_KEY, FifoChannel(2))
        arrived = subscriber.handler
        deadline = time.monotonic() + _MATCHING_S
        # Messages sent before the router knows the subscriber are lost.
        while arrived.try_recv() is None:
            if time.monotonic() > deadline:
                raise OSError("two Zenoh sessions on loopback cannot connect to each other")
            publisher.put(b"")
            time.sleep(0.05)
        while arrived.try_recv() is not None:
            pass

        def hop(payload: bytes) -> bytes:
            publisher.put(payload)
            return arrived.recv().payload.to_bytes()

        yield hop


def _out_and_in(message: Frame) -> Frame:
    return decode(encode(message), Frame)


def _sent(message: Frame, hop: Callable[[bytes], bytes]) -> Frame:
    return decode(hop(encode(message)), Frame)
