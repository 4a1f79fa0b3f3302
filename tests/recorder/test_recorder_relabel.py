import msgpack
import numpy as np
from recordings import frame

from spot3d.recorder.relabel import Labels
from spot3d_schemas import Frame, decode, encode

SENT_NS = 2
"""When `frame` was sent."""


def named(**names: str) -> bytes:
    """A frame with more names in its header."""
    fields = msgpack.unpackb(encode(frame(0, 5)))
    fields["header"] |= names
    return bytes(msgpack.packb(fields))


def test_a_message_under_its_own_name_is_not_touched() -> None:
    payload = encode(frame(0, 5))
    assert Labels("robot", "me").on(payload, SENT_NS) is payload


def test_all_but_the_names_is_as_it_was_and_aligned() -> None:
    sent = frame(3, 5)
    for robot in ("r", "another", "a-robot-with-a-name-that-is-long"):
        got = decode(Labels(robot, "me").on(encode(sent), SENT_NS), Frame)
        assert got.header == sent.header.model_copy(update={"robot": robot})
        assert (got.intrinsics, got.depth_scale) == (sent.intrinsics, sent.depth_scale)
        assert np.array_equal(got.colour, sent.colour)
        assert np.array_equal(got.depth, sent.depth)
        assert got.depth.flags.aligned
        again = decode(Labels("robot", "me").on(Labels(robot, "me").on(encode(sent), SENT_NS), SENT_NS), Frame)
        assert again == sent


def test_each_pass_names_streams_anew_and_this_process() -> None:
    def names(labels: Labels, **given: str) -> tuple[str, str]:
        header = msgpack.unpackb(labels.on(named(**given), 0))["header"]
        return header["stream"], header["sender"]

    first, second = Labels("robot", "me"), Labels("robot", "me")
    stream, sender = names(first, stream="s", sender="a")
    assert sender == "me"
    assert names(first, stream="s", sender="b") == (stream, "me")
    others = names(first, stream="t", sender="a")[0], names(second, stream="s", sender="a")[0]
    assert len({"s", stream, *others}) == 4


def test_a_trace_ends_now_and_is_as_long_as_it_was() -> None:
    sent = frame(0, 5)
    payload = encode(sent.model_copy(update={"header": sent.header.with_hop("pose", 50, 100)}))
    trace = decode(Labels("robot", "me").on(payload, 1100), Frame).header.trace
    assert [(hop.stage, hop.received_ns, hop.sent_ns) for hop in trace] == [
        ("source", 1001, 1002),
        ("pose", 1050, 1100),
    ]
