"""Stamps that are no nanoseconds of capture are told as such; those of recordings and of cameras that pause are not."""

import logging

import pytest

from spot3d.dataflow.admission import Admission
from spot3d.dataflow.alive import Alive
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.rate_limited_log import RateLimitedLog
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Header

S = 10**9


def told(stamps_ns: list[int], rate_hz: float = 10.0, delivery: str = "live", later_s: float = 0.0) -> str:
    """What is said of a camera with these stamps, frame after frame."""
    link = LinkSettings.model_validate({"delivery": delivery})
    log = RateLimitedLog(logging.getLogger("spot3d.test"))
    admission = Admission(("source/frame",), link, Alive(), Counters("pose", 0.0), log)
    now_s = 100.0
    for seq, stamp_ns in enumerate(stamps_ns):
        now_s = 100.0 + seq / rate_hz
        admission.judge("source/frame", Header(robot="r", seq=seq, stamp_ns=stamp_ns, frame_id="camera"), now_s)
    return admission.stamps(now_s + later_s)


def at(rate_hz: float, unit: int, count: int = 60) -> list[int]:
    return [int(seq / rate_hz * unit) + 45_000 * unit for seq in range(count)]


@pytest.mark.parametrize(
    ("stamps_ns", "said"),
    [
        (at(10, 10**6), "about 1,000 times too slowly"),
        (at(10, 10**3), "about 1,000,000 times too slowly"),
        ([5 * S] * 60, "do not advance"),
        ([seq // 10 * S for seq in range(60)], "do not advance from each to the next (6 of 60 differ)"),
        ([seq // 2 * S // 5 for seq in range(60)], ""),
        (at(10, S), ""),
        (at(10, S, 10) + [55_000 * S + seq * S // 10 for seq in range(60)], ""),
        ([*at(10, 10**3, 19)], ""),
        ([], ""),
    ],
    ids=[
        "microseconds",
        "milliseconds",
        "none",
        "whole seconds",
        "each twice",
        "nanoseconds",
        "after a pause",
        "too few",
        "nothing",
    ],
)
def test_the_unit_of_stamps_shows_by_their_pace(stamps_ns: list[int], said: str) -> None:
    text = told(stamps_ns)
    assert said in text if said else not text


def test_a_recording_that_is_played_slowly_is_none_of_these() -> None:
    assert told(at(30, S), rate_hz=0.5) == ""
    assert told(at(10, 10**6), delivery="lossless") == ""


def test_who_has_gone_is_not_spoken_of() -> None:
    assert told(at(10, 10**6), later_s=9.0)
    assert told(at(10, 10**6), later_s=11.0) == ""
