"""The clock of a replay, in steps of time that a test sets."""

import threading
import time

import pytest

from spot3d.dataflow.pace import Pace


class Clock:
    """Monotonic seconds that pass only while somebody rests, and what a replay notes."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.noted: list[tuple[str, str]] = []

    def rest(self, seconds: float) -> None:
        self.now_s += seconds

    def note(self, kind: str, text: str) -> None:
        self.noted.append((kind, text))


@pytest.mark.parametrize(
    ("rate", "recorded_s", "reached_s", "noted"),
    [
        (1.0, [0, 1, 2.5], [0, 1, 2.5], []),
        (4.0, [0, 1, 2], [0, 0.25, 0.5], []),
        (0.1, [0, 20, 40], [0, 200, 400], []),  # as slow as it is told to be
        (1.0, [0, 20, 40], [0, 20, 40], []),  # a time lapse
        (1.0, [0, 1, 1e9, 1e9 + 1], [0, 1, 1, 2], [("gap", "a gap of 999999999 s in the recording is skipped")]),
        (2.0, [0, 70, 72], [0, 0, 1], [("gap", "a gap of 70 s in the recording is skipped")]),
    ],
)
def test_what_is_recorded_is_due_in_its_time_but_for_gaps(
    rate: float,
    recorded_s: list[float],
    reached_s: list[float],
    noted: list[tuple[str, str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic", lambda: clock.now_s)
    pace, stop, told = Pace(rate, clock.note), threading.Event(), []
    for at_s in recorded_s:
        assert pace.wait(at_s, stop, clock.rest)
        told.append(clock.now_s - 100)
    assert told == pytest.approx(reached_s, abs=1e-6)
    assert clock.noted == noted


def test_a_late_replay_goes_on_from_now(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic", lambda: clock.now_s)
    pace, stop = Pace(1.0, clock.note), threading.Event()
    for at_s, late_s, then_s in ((1.0, 3.0, 103.0), (2.0, 0.0, 104.0), (3.0, 1.4, 105.4), (4.0, 0.0, 106.0)):
        clock.now_s += late_s
        assert pace.wait(at_s, stop, clock.rest)
        assert clock.now_s == pytest.approx(then_s)
    assert clock.noted == [("behind", "playing is 2.0 s late, and continues from here without catching up")]
    stop.set()
    assert not pace.wait(5.0, stop, clock.rest)
