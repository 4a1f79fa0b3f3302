"""Counters, the rate-limited log, the inbox and the table of qualities."""

import logging
import os
import threading

import pytest

from spot3d.dataflow.alive import Alive, watch_alive
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.endpoints import keeps_newest, waiting
from spot3d.dataflow.inbox import Inbox, Tray
from spot3d.dataflow.ledger import Ledger
from spot3d.dataflow.node import Node
from spot3d.dataflow.process_use import ProcessUse, process_use
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import TOPICS, Header, Health, Progress, alive_key, decode, encode
from spot3d_schemas.limits import MAX_COUNT

HEADER = Header(robot="r", seq=0, stamp_ns=1, frame_id="pose")
USE = ProcessUse(cpu_s=1.5, rss_bytes=1000, threads=3)


def test_health_without_anything() -> None:
    health = Counters("pose", 10.0).health(HEADER, 10.0, USE)
    assert (health.received, health.published, health.drops, health.errors) == (0, 0, {}, 0)
    assert (health.rate_hz, health.latency_ms_p50, health.step_ms_p99) == (None, None, None)
    assert (health.pid, health.cpu_s, health.rss_bytes, health.threads) == (os.getpid(), 1.5, 1000, 3)


def test_counts_that_others_make_up_stay_within_the_contract() -> None:
    counters, ledger = Counters("fusion", 10.0), Ledger(1.0)
    for _ in range(2):
        counters.drop("lost on the way", MAX_COUNT)
        ledger.end(MAX_COUNT, 1, 0.0)
        ledger.close()
        ledger.fuse(2, 0.0)
    assert counters.health(HEADER, 10.0, USE).drops == {"lost on the way": MAX_COUNT}
    Progress(header=HEADER, fused=1, skipped=dict(ledger.skipped), last_stamp_ns=1, complete=False)


def test_health_counts() -> None:
    counters = Counters("pose", 10.0)
    for milliseconds in range(1, 102):
        counters.received()
        counters.step(1e-3 * milliseconds)
        counters.latency(2_000_000 * milliseconds)
    counters.published("pose/pose", 100)
    counters.drop("busy", 0)
    counters.drop("late", 2)
    counters.drop("late")
    counters.event("behind")
    counters.error("first")
    counters.error("second")
    health = counters.health(HEADER, 12.0, USE)
    assert (health.received, health.published, health.drops) == (101, 1, {"late": 3})
    assert (health.events, health.errors, health.last_error) == ({"behind": 1}, 2, "second")
    assert (health.uptime_s, health.rate_hz) == (2.0, 50.5)
    assert health.step_ms_p50 == pytest.approx(51)
    assert health.step_ms_p99 == pytest.approx(100)
    assert health.latency_ms_p50 == pytest.approx(102)
    assert counters.health(HEADER, 13.0, USE).rate_hz == 0.0, "the rate is that since the last report"


def test_process_use() -> None:
    use = process_use()
    assert use.cpu_s > 0
    assert use.rss_bytes > 10**6
    assert use.threads >= 1


def test_lines_of_one_reason_are_few(caplog: pytest.LogCaptureFixture) -> None:
    limited_log = RateLimitedLog(logging.getLogger("test"))
    with caplog.at_level("WARNING"):
        said = [limited_log.say("a", f"a {i}", 0.1 * i) for i in range(150)]
        assert [i for i, one in enumerate(said) if one] == [0, 100]
        assert caplog.messages == ["a 0", "a 100 (99 more since the last one)"]
        assert limited_log.say("b", "b", 0.0)
        assert sum(limited_log.say(f"reason {i}", "made up", 1.0) for i in range(10_000)) < 70


def test_the_first_of_a_kind_is_logged_with_its_traceback(caplog: pytest.LogCaptureFixture) -> None:
    node = Node("pose", LinkSettings(), threading.Event())

    def divide() -> None:
        try:
            _ = 1 / 0
        except ZeroDivisionError as error:
            node.crashed("pose", "no pose", error)

    divide()
    node._limited_log._said["pose ZeroDivisionError"] = (float("-inf"), 3)  # long ago
    divide()
    first, second = caplog.messages
    assert first.startswith("no pose: ZeroDivisionError: division by zero\nTraceback")
    assert "in divide" in first
    assert second == "no pose: ZeroDivisionError: division by zero (3 more since the last one)"
    assert node.counters.health(HEADER, 10.0, USE).errors == 2


def test_inbox_gives_in_the_order_of_arrival() -> None:
    inbox = Inbox({"a": Tray(2, True), "b": Tray(2, False)})
    assert inbox.get(0.0) is None
    assert [inbox.put("a", 1), inbox.put("b", 2), inbox.put("a", 3), inbox.put("a", 4)] == [0, 0, 0, 1]
    assert [inbox.get(0.0) for _ in range(4)] == [("b", 2), ("a", 3), ("a", 4), None]


def test_a_full_tray_that_keeps_all_lets_the_sender_wait() -> None:
    inbox = Inbox({"a": Tray(1, False)})
    inbox.put("a", 1)
    sender = threading.Thread(target=inbox.put, args=("a", 2), daemon=True)
    sender.start()
    assert inbox.get(5.0) == ("a", 1)
    assert inbox.get(5.0) == ("a", 2)
    sender.join(5)
    assert not sender.is_alive()


def test_a_closed_inbox_lets_go() -> None:
    inbox = Inbox({"a": Tray(1, False)})
    inbox.put("a", 1)
    sender = threading.Thread(target=inbox.put, args=("a", 2), daemon=True)
    sender.start()
    inbox.close()
    sender.join(5)
    assert not sender.is_alive()


def test_alive() -> None:
    alive, stop = Alive(), threading.Event()
    assert alive.missing((), 0.0, stop) == ()
    alive.note("pose", True)
    assert "pose" in alive
    assert alive.missing(("pose", "fusion"), 0.0, stop) == ("fusion",)
    alive.note("pose", False)
    alive.note("pose", False)
    assert "pose" not in alive
    stop.set()
    assert alive.missing(("pose",), 1e6, stop) == ("pose",)


def test_nobody_watches_any_more_after_an_exception() -> None:
    with open_router((free_loopback_endpoint(),)) as session:
        with pytest.raises(ZeroDivisionError), watch_alive(session, "robot"):
            raise ZeroDivisionError
        assert "alive" not in [thread.name for thread in threading.enumerate()]


def test_how_much_waits_of_every_published_topic() -> None:
    live, lossless = LinkSettings(), LinkSettings(delivery="lossless", in_flight=4)
    for topic in (name for name, row in TOPICS.items() if row.kind == "pub"):
        assert 1 <= waiting(topic, live) <= 64
        assert waiting(topic, lossless) >= 1
        assert not keeps_newest(topic, lossless)
        if TOPICS[topic].delivery == "lossless":
            assert not keeps_newest(topic, live)
    assert waiting("source/frame", lossless) > lossless.in_flight


@pytest.mark.parametrize(
    "wrong",
    [{"robot": "a/b"}, {"connect": ["127.0.0.1:7447"]}, {"in_flight": 0}, {"delivery": "fast"}, {"robots": 1}],
)
def test_wrong_link_settings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        LinkSettings(**wrong)


def test_a_text_that_utf8_does_not_have_is_told_all_the_same() -> None:
    """As of a file whose name is of another encoding; what is wrong now may name it as well."""
    counters = Counters("source", 10.0)
    counters.error("caf\udce9/7.png is not a readable image")
    health = decode(encode(counters.health(HEADER, 10.0, USE, "caf\udce9 is full")), Health)
    assert (health.last_error, health.state) == (r"caf\udce9/7.png is not a readable image", r"caf\udce9 is full")


def test_tokens_that_anybody_may_declare_end_nothing() -> None:
    """One with a wildcard meets the subscription of everybody who watches."""
    with open_router((free_loopback_endpoint(),)) as session, watch_alive(session, "robot") as alive:
        tokens = [session.liveliness().declare_token(where) for where in ("spot3d/**", alive_key("robot", "fusion"))]
        assert alive.missing(("fusion",), 20.0, threading.Event()) == ()
        assert not alive.missing(("fusion",), 0.0, threading.Event())
        for token in tokens:
            token.undeclare()
