"""Clocks that differ are told in words, and lags that they spoil are not told at all."""

import datetime
import queue
import threading
import time

import numpy as np
import pytest
import zenoh
from dataflow_stages import LIMIT_S, Recording, frame_message, listening
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from spot3d.dataflow.clocks import Clocks, one_clock, spoken
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.serving import On, serve
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Frame, Header, Proposals, encode, encoding, key

MS, S, HOUR = 10**6, 10**9, 3600 * 10**9


def sent(stage: str, sent_ns: int) -> Header:
    return Header(robot="r", seq=0, stamp_ns=1, frame_id="camera").with_hop(stage, sent_ns - MS, sent_ns)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.2, "about 200 ms"),
        (1.0, "about 1 second"),
        (-45.0, "about 45 seconds"),
        (-3600.044, "about 1 hour"),
        (9000.0, "about 2.5 hours"),
        (86400.0 * 19000, "about 19000 days"),
    ],
)
def test_times_in_words(seconds: float, said: str) -> None:
    assert spoken(seconds) == said


@pytest.mark.parametrize(
    ("way_ns", "same"), [(44 * MS, True), (-44 * MS, True), (3 * S, True), (HOUR, False), (-HOUR, False)]
)
def test_what_no_way_explains_is_the_clocks(way_ns: int, same: bool) -> None:
    header = sent("source", HOUR).with_hop("pose", HOUR + way_ns, HOUR + way_ns + MS)
    assert one_clock(header.trace) == same
    clocks = Clocks()
    for _ in range(10):
        clocks.observe(sent("source", HOUR), HOUR + way_ns, 0.0)
    assert (clocks.notice(1.0) == "") == same


def test_the_clock_that_differs_most_is_told_while_its_device_is_heard() -> None:
    clocks = Clocks()
    assert clocks.notice(0.0) == ""
    for number in range(10):
        clocks.observe(sent("pose", 5 * HOUR), 5 * HOUR + MS, 0.0)
        clocks.observe(sent("heatmap", 5 * HOUR), 4 * HOUR, 0.0)
        # One that is made up says nothing.
        clocks.observe(sent("source", 5 * HOUR), 0 if number == 3 else 5 * HOUR, 0.0)
        clocks.observe(sent("nobody", 5 * HOUR), 0, 0.0)
    told = clocks.notice(1.0)
    assert told.startswith("the clock of the device that runs heatmap is about 1 hour ahead of this one,")
    assert clocks.notice(11.0) == ""


def test_a_stage_says_that_clocks_differ_by_an_hour_and_tells_no_lag() -> None:
    endpoint, stop = free_loopback_endpoint(), threading.Event()
    link = LinkSettings(robot="late", connect=(endpoint,), health_interval_s=0.1)
    with (
        open_router((endpoint,)) as session,
        listening(session, "late") as ear,
        Node("proposals", link, stop, ("source/frame",), ("proposals/boxes",)) as node,
    ):

        def answer(given: Received[Frame]) -> None:
            header = node.header("proposals/boxes", given)
            node.publish("proposals/boxes", Proposals(header=header, boxes=np.zeros((0, 5), np.float32)))
            node.measure_latency(header)

        serving = threading.Thread(target=serve, args=(node, On("source/frame", Frame, answer)))
        serving.start()
        try:
            end_s = time.monotonic() + LIMIT_S
            for seq, frame in enumerate(Recording(100_000)):
                if (health := ear.health("proposals")) and health.state:
                    break
                assert time.monotonic() < end_s
                time.sleep(0.02)
                message = frame_message(frame, "late", seq)
                early_ns = time.time_ns() - HOUR
                header = message.header.model_copy(update={"trace": ()}).with_hop("source", early_ns, early_ns)
                payload = encode(message.model_copy(update={"header": header}))
                session.put(key("late", "source/frame"), payload, encoding=encoding(Frame))
        finally:
            stop.set()
            serving.join(20)
    assert health is not None
    assert "the clock of the device that runs source is about 1 hour behind this one," in health.state
    assert health.latency_ms_p50 is None


def test_what_is_kept_reaches_who_comes_late_without_any_stamp() -> None:
    endpoint, came = free_loopback_endpoint(), queue.SimpleQueue[tuple[bytes, object]]()
    link = LinkSettings(robot="late", connect=(endpoint,))
    with open_router((endpoint,)), open_session(link) as sender, open_session(link) as reader:
        publisher = declare_publisher(sender, "fusion/objects", link)
        passed = queue.SimpleQueue[bytes]()
        witness = reader.declare_subscriber(key("late", "fusion/objects"), lambda s: passed.put(s.payload.to_bytes()))
        end_s = time.monotonic() + LIMIT_S
        while passed.empty():
            assert time.monotonic() < end_s
            publisher.put(b"first")
            time.sleep(0.02)
        publisher.put(b"last")
        while passed.get(timeout=LIMIT_S) != b"last":  # what the router has passed on comes to nobody who is late
            pass
        witness.undeclare()
        declare_advanced_subscriber(
            reader,
            key("late", "fusion/objects"),
            lambda sample: came.put((sample.payload.to_bytes(), sample.timestamp)),
            history=HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
        assert came.get(timeout=LIMIT_S) == (b"last", None)
        publisher.put(b"next")
        assert came.get(timeout=LIMIT_S) == (b"next", None)


def test_no_router_logs_each_message_of_a_clock_that_is_ahead(capfd: pytest.CaptureFixture[str]) -> None:
    endpoint = free_loopback_endpoint()
    ahead = zenoh.Timestamp(datetime.datetime.now(datetime.UTC) + datetime.timedelta(hours=1), b"\x01")
    came = threading.Event()
    link = LinkSettings(connect=(endpoint,))
    with open_router((endpoint,)), open_session(link) as sender, open_session(link) as reader:
        reader.declare_subscriber("spot3d/x", lambda _: came.set())
        end_s = time.monotonic() + LIMIT_S
        while not came.wait(0.05):
            assert time.monotonic() < end_s
            sender.put("spot3d/x", b"", timestamp=ahead)
    said = capfd.readouterr()
    assert "timestamp" not in said.out + said.err
