"""Credit, ledger, cadence and stream order: who waits for what, and what counts."""

import pytest

from spot3d.dataflow.cadence import Cadence
from spot3d.dataflow.credit import Credit
from spot3d.dataflow.ledger import NEVER_ARRIVED, Ledger
from spot3d.dataflow.order import RESTART_NS, Arrival, StreamOrder

S = 1_000_000_000


def test_credit_is_used_up_and_comes_back() -> None:
    credit = Credit(2)
    assert not credit.used_up
    credit.sent(10)
    credit.sent(20)
    assert credit.used_up
    assert credit.answered(9) == 0
    assert credit.answered(10) == 1
    assert (credit.used_up, credit.outstanding) == (False, 1)
    assert credit.answered(99) == 1
    assert credit.answered(99) == 0


def test_credit_that_is_given_up_counts_as_lost() -> None:
    credit = Credit(2)
    assert credit.give_up() == []
    credit.sent(10)
    credit.sent(20)
    assert credit.give_up() == [10, 20]
    assert (credit.lost, credit.outstanding, credit.used_up) == (2, 0, False)
    assert credit.answered(20) == 0, "an answer that comes too late is no credit"


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
        ([(0, 10)], Arrival()),
        ([(7, 10)], Arrival()),  # who comes late has missed nothing that it was promised
        ([(0, 10), (1, 20)], Arrival()),
        ([(0, 10), (4, 20)], Arrival(missing=3)),
        ([(9, 10), (0, 20)], Arrival()),  # the sender starts anew
        ([(0, 10), (1, 10)], Arrival("duplicate stamp")),
        ([(0, 10), (1, 9)], Arrival("out of order")),
        ([(0, 10), (1, 9), (2, 20)], Arrival(missing=1)),
        ([(0, 5 + RESTART_NS), (0, 5)], Arrival(restarted=True)),
        ([(0, 5 + RESTART_NS), (0, 5), (1, 6)], Arrival()),
    ],
)
def test_stream_order(messages: list[tuple[int, int]], last: Arrival) -> None:
    order = StreamOrder()
    arrivals = [order.check(seq, stamp) for seq, stamp in messages]
    assert arrivals[-1] == last
