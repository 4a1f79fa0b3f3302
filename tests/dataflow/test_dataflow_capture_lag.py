"""Frames that a camera program sends later and later after their capture are told of, by how much."""

import logging
from collections.abc import Callable

import pytest

from spot3d.dataflow.admission import Admission
from spot3d.dataflow.alive import Alive
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Header

S = 10**9
WALL_S = 1_700_000_000.0
HZ = 20


def told(
    lag_s: Callable[[float], float],
    seconds: float = 30.0,
    clock_s: Callable[[float], float] = lambda at_s: WALL_S + at_s,
    stamps_from_s: float = WALL_S,
    traced: bool = True,
    delivery: str = "live",
    later_s: float = 0.0,
) -> str:
    """What is said at last of a camera whose frames are sent so late; clock_s: the wall clock of the sender."""
    link = LinkSettings.model_validate({"delivery": delivery})
    log = RateLimitedLog(logging.getLogger("spot3d.test"))
    admission = Admission(("source/frame",), link, Alive(), Counters("pose", 0.0), log)
    now_s = 0.0
    for seq in range(int(HZ * seconds)):
        taken_s = seq / HZ
        now_s = taken_s + lag_s(taken_s)
        header = Header(robot="r", seq=seq, stamp_ns=int((stamps_from_s + taken_s) * S), frame_id="camera")
        sent_ns = int(clock_s(now_s) * S)
        admission.judge("source/frame", header.with_hop("source", sent_ns, sent_ns) if traced else header, now_s)
    return admission.stamps(now_s + later_s)


def grows(at_s: float) -> float:
    return 0.05 + 0.1 * at_s


@pytest.mark.parametrize(
    ("lag_s", "said"),
    [
        (grows, "the delay from capture to sending has grown by 2.8 s: "),
        (lambda at_s: 0.05 + min(0.1 * at_s, 1.0), "the delay from capture to sending has grown by 1.0 s"),
        (lambda at_s: 0.05 + 0.01 * at_s, ""),
        (lambda _: 0.8, ""),
        (lambda at_s: 0.05 + max(0.0, 0.9 - abs(at_s - 28.0)), ""),
        (lambda at_s: grows(at_s) if at_s < 20 else 0.05, ""),
    ],
    ids=["a queue that grows", "one that is full", "0.3 s", "always late", "a stall that is made up for", "recovered"],
)
def test_a_growing_lag_is_told(lag_s: Callable[[float], float], said: str) -> None:
    text = told(lag_s)
    assert text.startswith(said) if said else not text


def test_what_is_no_wall_clock_says_nothing() -> None:
    assert told(grows, stamps_from_s=0.0) == "", "a device's clock, or a recording that is played slowly"
    assert told(grows, traced=False) == ""
    assert told(grows, delivery="lossless") == ""
    assert told(grows, later_s=11.0) == "", "the camera is gone"


def test_a_clock_that_is_set_or_drifts_is_no_lag() -> None:
    assert told(lambda _: 0.05, clock_s=lambda at_s: WALL_S + at_s + 5.0 * (at_s > 15)) == ""
    assert told(lambda _: 0.05, clock_s=lambda at_s: WALL_S + at_s - 5.0 * (at_s > 15)) == ""
    assert told(lambda _: 0.05, clock_s=lambda at_s: WALL_S + 1.0001 * at_s, seconds=7200.0) == ""
