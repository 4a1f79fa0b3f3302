"""Credit, ledger, cadence and stream order: who waits for what, and what counts."""

import pytest

from spot3d.dataflow.alive import Alive
from spot3d.dataflow.cadence import Cadence
from spot3d.dataflow.credit import Credit
from spot3d.dataflow.ledger import IN_RESTART, NEVER_ARRIVED, Ledger
from spot3d.dataflow.order import RESTART_NS, StreamOrder, Verdict
from spot3d.dataflow.producers import Producers
from spot3d.dataflow.streams import Streams
from spot3d_schemas import Header

S = 1_000_000_000


def test_credit_is_used_up_and_comes_back() -> None:
    credit = Credit(2)
    assert credit.outstanding == 0
    credit.sent(10)
    credit.sent(20)
    assert credit.outstanding == credit.in_flight
    for stamp_ns, outstanding in ((9, 2), (10, 1), (99, 0), (99, 0)):
        credit.answered(stamp_ns)
        assert credit.outstanding == outstanding


def test_credit_that_is_given_up_names_what_is_lost() -> None:
    credit = Credit(2)
    assert credit.give_up() == []
    credit.sent(10)
    credit.sent(20)
    assert credit.give_up() == [10, 20]
    assert credit.outstanding == 0
    credit.answered(20)
    assert credit.outstanding == 0, "an answer that comes too late is no credit"


def test_ledger_is_complete_with_the_last_frame() -> None:
    ledger = Ledger(patience_s=5)
    ledger.fuse(10, 0.0)
    assert not ledger.end(3, 30, 0.5)
    ledger.skip("lost pose", 20, 1.0)
    assert not ledger.due(1.0)
    ledger.fuse(30, 1.1)
    assert ledger.due(1.1)
    assert ledger.close() == 0
    assert (ledger.fused, ledger.skipped, ledger.complete) == (2, {"lost pose": 1}, True)
    assert not ledger.due(99.0)
    assert ledger.end(3, 30, 2.0), "the same end again is answered at once"


def test_ledger_counts_what_never_arrived() -> None:
    ledger = Ledger(patience_s=5)
    ledger.fuse(10, 0.0)
    ledger.end(4, 40, 1.0)
    ledger.end(4, 40, 4.0)
    assert not ledger.due(5.9)
    assert ledger.due(6.0)
    assert ledger.close() == 3
    assert (ledger.skipped[NEVER_ARRIVED], ledger.last_stamp_ns) == (3, 40)


def test_ledger_counts_what_an_earlier_process_has_forgotten() -> None:
    """Fusion goes on from an account of two frames, after it had seen five; then the source is started again."""
    ledger = Ledger(patience_s=5)
    ledger.go_on(2, {}, 20, in_stream=2)
    ledger.fuse(60, 0.0)
    ledger.end(6, 60, 0.0)
    assert ledger.close() == 3
    assert ledger.skipped == {IN_RESTART: 3}
    assert ledger.end(5, 60, 1.0), "a source that is started again at the end may count otherwise"
    assert not ledger.due(99.0)
    assert ledger.skipped == {IN_RESTART: 3}


def test_ledger_waits_for_more_than_frames_while_it_comes() -> None:
    ledger = Ledger(patience_s=5)
    ledger.fuse(10, 0.0)
    ledger.end(1, 10, 1.0)
    assert not ledger.due(5.9, more=True)
    ledger.extend_patience(5.9)
    assert not ledger.due(10.8, more=True)
    assert ledger.due(10.8), "nothing more is to come"
    assert ledger.due(10.9, more=True), "it has not come"
    assert ledger.close() == 0


def test_ledger_of_an_empty_stream() -> None:
    ledger = Ledger(patience_s=5)
    ledger.end(0, 0, 0.0)
    assert ledger.due(0.0)
    assert ledger.close() == 0


def test_ledger_of_two_streams() -> None:
    ledger = Ledger(patience_s=5)
    for start in (100 * S, S):
        ledger.fuse(start, 0.0)
        assert not ledger.complete
        assert not ledger.end(2, start + 1, 0.0)
        ledger.fuse(start + 1, 0.0)
        assert ledger.due(0.0)
        assert ledger.close() == 0
    assert ledger.fused == 4


def test_ledger_reset_keeps_the_stream() -> None:
    ledger = Ledger(patience_s=5)
    ledger.fuse(10, 0.0)
    ledger.reset()
    ledger.fuse(20, 0.0)
    ledger.end(2, 20, 0.0)
    assert ledger.close() == 0
    assert ledger.fused == 1


@pytest.mark.parametrize(
    ("stamps_ms", "due_ms"),
    [
        ([], []),
        ([0], []),
        ([0, 200, 399], []),
        ([0, 200, 400, 600, 800], [400, 800]),
        ([0, 1000, 1100, 1400], [1000, 1400]),
        ([5000, 5100, 0, 300, 400], [400]),  # another recording
    ],
)
def test_cadence(stamps_ms: list[int], due_ms: list[int]) -> None:
    cadence = Cadence(0.4)
    assert [stamp for stamp in stamps_ms if cadence.due(stamp * 1_000_000)] == due_ms


def test_cadence_postponed_and_reset() -> None:
    cadence = Cadence(0.4)
    assert not cadence.due(0)
    assert cadence.due(S)
    cadence.postpone()
    assert cadence.due(S + 1)
    cadence.reset()
    assert not cadence.due(2 * S)


@pytest.mark.parametrize(
    ("messages", "last"),
    [
        ([(0, 10)], Verdict()),
        ([(7, 10)], Verdict()),  # who comes late has missed nothing that it was promised
        ([(0, 10), (1, 20)], Verdict()),
        ([(0, 10), (4, 20)], Verdict(missing=3)),
        ([(9, 10), (0, 20)], Verdict()),  # the sender starts anew
        ([(0, 10), (1, 10)], Verdict("duplicate stamp")),
        ([(0, 10), (1, 9)], Verdict("out of order")),
        ([(0, 10), (1, 9), (2, 20)], Verdict()),  # what is refused has arrived
        ([(0, 10), (3, 10)], Verdict("duplicate stamp", missing=2)),
        ([(0, 10), (3, 30), (1, 20), (4, 40)], Verdict()),
        ([(0, 5 + RESTART_NS), (0, 5)], Verdict(restarted=True)),
        ([(0, 5 + RESTART_NS), (0, 5), (1, 6)], Verdict()),
    ],
)
def test_stream_order(messages: list[tuple[int, int]], last: Verdict) -> None:
    order = StreamOrder()
    arrivals = [order.check(header(seq, stamp), 0.0) for seq, stamp in messages]
    assert arrivals[-1] == last


def header(seq: int, stamp_ns: int, stream: str | None = None, sender: str | None = None) -> Header:
    return Header(robot="r", seq=seq, stamp_ns=stamp_ns, frame_id="camera", stream=stream, sender=sender)


@pytest.mark.parametrize(
    ("stamps_s", "refused"),
    [
        ([10, 11, 12], []),
        ([10, 15, 11, 12], [15]),  # a stray stamp some seconds ahead
        ([10, 13, 14, 15], [13]),  # a gap that took no time
        ([10, 3610, 11, 12], [3610]),  # a stray stamp an hour ahead
        ([10, 3610, 3611, 3612], [3610]),  # the clock was set, and stays so
        ([3610, 10, 3611], [10]),
        ([3610, 10, 11, 12], [10]),  # set back
        ([3610, 10, 10, 10, 3611], [10, 10, 10]),
        ([10, 19, 28, 37], [19]),  # a sparse recording that is played fast
        ([10, 30, 50, 70, 90], [30]),
        ([10, 30, 40, 90, 100], [30, 90]),  # its steps differ
        ([10, 30, 50, 3650, 70, 90], [30, 3650]),  # a stray stamp in it, ahead
        ([10, 3610, 30, 50, 70], [3610, 30]),
        ([10, 30, 50, 15, 70, 90], [30, 15]),  # and back
        ([1010, 1030, 1050, 5, 1070, 1090], [1030, 5]),
        ([1010, 1030, 1050, 5, 25, 45], [1030, 5]),  # begun again
        ([110, 5, 130, 150, 170], [5, 130]),
    ],
)
def test_a_stray_stamp_of_a_camera_is_refused_alone(stamps_s: list[int], refused: list[int]) -> None:
    order = StreamOrder(confirm=True)
    arrivals = [order.check(header(seq, stamp * S, "a"), 0.033 * seq) for seq, stamp in enumerate(stamps_s)]
    told = [stamp for stamp, arrival in zip(stamps_s, arrivals, strict=True) if arrival.refused]
    assert told == refused
    assert {arrival.refused for arrival in arrivals} <= {"", "stray stamp"}


def test_a_slow_camera_and_a_silent_one_are_believed() -> None:
    order = StreamOrder(confirm=True)
    arrivals = [order.check(header(seq, at * S, "a"), at) for seq, at in enumerate((10, 19, 28, 29, 60))]
    assert not any(arrival.refused for arrival in arrivals)


def test_a_named_stream_never_goes_back_and_another_begins_anywhere() -> None:
    order = StreamOrder()
    assert order.check(header(0, 50 * S, "a", "x"), 0.0) == Verdict()
    assert order.check(header(1, 5 * S, "a", "x"), 0.1) == Verdict("out of order")
    assert order.check(header(3, 5 * S, "b", "x"), 0.2) == Verdict(missing=1)
    assert order.check(header(9, 6 * S, "b", "y"), 0.3) == Verdict(), "another process counts for itself"


def test_a_camera_that_names_no_stream_begins_anew_after_one_that_does() -> None:
    order = StreamOrder(confirm=True)
    heard = [(50, "a"), (5, None), (6, None), (7, None)]
    arrivals = [order.check(header(seq, at * S, stream), seq) for seq, (at, stream) in enumerate(heard)]
    assert arrivals == [Verdict(), Verdict("stray stamp"), Verdict(restarted=True), Verdict()]


def test_streams_follow_each_other_and_do_not_come_back() -> None:
    streams = Streams()
    told = [streams.judge(name, now_s) for now_s, name in enumerate((None, "a", "a", "b", "a", None, "b"))]
    assert told == ["same", "begins", "same", "begins", "earlier", "same", "same"]
    assert streams.current == "b"
    assert streams.judge("a", 99.0) == "begins", "nothing came of the other for long"


def test_the_first_producer_keeps_its_topic_until_it_is_gone() -> None:
    alive = Alive()
    producers, topic = Producers(alive), "source/frame"
    alive.note_process("source", "a", True)
    assert producers.admit(topic, "a", 0.0)
    assert not producers.admit(topic, "b", 5.0), "it is there, however silent"
    assert not producers.admit(topic, None, 5.0)
    assert producers.admit(topic, "a", 5.1)
    assert producers.admit("pose/pose", "b", 5.1), "each topic has its own"
    assert (producers.contested(6.0), producers.contested(99.0)) == ([topic], [])
    alive.note_process("source", "a", False)
    assert producers.admit(topic, "b", 5.2), "gone is gone at once"
    assert not producers.admit(topic, "a", 5.3), "one without a token is there for half a second"
    assert producers.admit(topic, "a", 6.0)
    alive.note_process("source", "c", True)
    assert producers.admit(topic, "c", 6.1), "or until one with a token comes"
