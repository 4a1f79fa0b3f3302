"""How stages fare is told in words: what is waited for, and for how long."""

from typing import Any

import pytest

from spot3d.dashboard.health import StageRecords
from spot3d_schemas import BRIDGE, STAGES, Header, Health


def header(sender: str | None) -> Header:
    return Header(robot="robot", seq=0, stamp_ns=1, frame_id="fusion", sender=sender)


def health(stage: str, **changes: Any) -> Health:
    fields = {
        "header": Header(robot="robot", seq=0, stamp_ns=1, frame_id=stage),
        "stage": stage,
        "pid": 1,
        "uptime_s": 1.0,
        "received": 0,
        "published": 0,
        "drops": {},
        "events": {},
        "errors": 0,
        "last_error": "",
        "rate_hz": 30.0,
        "latency_ms_p50": 40.0,
        "latency_ms_p99": 60.0,
        "step_ms_p50": 8.0,
        "step_ms_p99": 12.0,
        "cpu_s": 1.0,
        "rss_bytes": 1,
        "threads": 1,
    }
    return Health(**fields | changes)


def said(records: StageRecords, stage: str, now_s: float, alive: tuple[str, ...] = STAGES, lost: str = "") -> str:
    (word,) = [word for word in records.words(alive, now_s, lost) if word.stage == stage]
    return f"{word.level}: {word.text}"


def working(until_s: int, silent: tuple[str, ...] = ()) -> StageRecords:
    """All stages at work, once a second."""
    records = StageRecords()
    for second in range(until_s + 1):
        for stage in STAGES:
            if stage not in silent:
                records.receive(health(stage, received=30 * second), float(second))
    return records


def test_nothing_was_heard_yet() -> None:
    records = StageRecords()
    assert said(records, "pose", 5.0, alive=()) == "bad: is not running"
    assert said(records, "pose", 5.0) == "waits: is running, but has not published its health yet"
    assert records.latest("pose") is None


def test_all_is_well() -> None:
    assert said(working(8), "fusion", 8.2) == "good: 30 a second, 8 ms per step, 40 ms behind the camera"


def test_a_stage_that_has_gone() -> None:
    records = working(8)
    assert said(records, "pose", 8.9, alive=("source",)) == "bad: is not running (for 1 s)"
    assert said(records, "pose", 20.0, alive=("source",)) == "bad: is not running (for 12 s)"


def test_a_stage_that_hangs_is_given_up_after_two_seconds() -> None:
    records, others = working(8), tuple(stage for stage in STAGES if stage != "heatmap")
    assert said(records, "heatmap", 9.9).startswith("good")
    silent = "for {} s: it hangs, or the link to it is cut"
    assert said(records, "heatmap", 10.1, others) == f"bad: has not answered {silent.format(2)}"
    for second in (11, 12):
        for stage in others:
            rate_hz = 0.0 if stage in ("segments", "fusion") else 30.0
            records.receive(health(stage, received=30 * second, rate_hz=rate_hz), float(second))
    assert said(records, "heatmap", 12.2, others) == f"bad: has not answered {silent.format(4)}"
    assert said(records, "fusion", 12.2, others) == "waits: waits: no heat for 4.2 s, because heatmap does not answer"
    assert said(records, "heatmap", 13.0).startswith("bad: has sent nothing for 5 s: it hangs")
    records.receive(health("heatmap", received=300), 13.1)
    assert said(records, "heatmap", 13.2).startswith("good")


def test_who_waits_says_for_what_and_since_when() -> None:
    records = working(8)
    for second in (9, 10, 11):
        for stage in STAGES:
            idle = stage in ("pose", "fusion")
            records.receive(health(stage, received=30 * second, rate_hz=0.0 if idle else 30.0), float(second))
    assert said(records, "fusion", 11.2) == "waits: waits: no pose for 3.2 s"
    assert said(records, "pose", 11.2) == "bad: receives input, but has produced no output for 3.2 s"
    assert said(records, "heatmap", 11.2).startswith("good")
    alone = tuple(stage for stage in STAGES if stage != "pose")
    assert said(records, "fusion", 11.2, alone) == "waits: waits: no pose for 3.2 s, because pose is not running"


def test_of_those_who_say_nothing_of_themselves_nothing_is_said() -> None:
    records = working(8, silent=("pose", "heatmap"))
    for second in (9, 10, 11):
        records.receive(health("fusion", rate_hz=0.0), float(second))
    assert said(records, "fusion", 11.0) == "waits: has produced no output for 3.0 s"


def test_a_camera_program_that_stops_is_waited_for() -> None:
    """It says nothing of itself; whether its frames come, their readers tell."""
    records = working(8, silent=("source",))
    for second in (9, 10, 11):
        for stage in STAGES[1:]:
            records.receive(health(stage, rate_hz=0.0, received=240), float(second))
    assert said(records, "pose", 11.0) == "waits: waits: no frame for 3.0 s"
    assert said(records, "source", 11.0) == "waits: is running, but has not published its health yet"
    assert "as your own program may not" in said(records, "source", 16.0)


def test_at_the_end_of_a_recording_everybody_waits_for_frames() -> None:
    records = working(8)
    for second in (9, 10, 11):
        for stage in STAGES:
            records.receive(health(stage, rate_hz=0.0), float(second))
    assert said(records, "source", 11.0).startswith("waits: has sent no frame for 3.0 s")
    assert said(records, "pose", 11.0) == "waits: waits: no frame for 3.0 s"
    assert said(records, "segments", 11.0) == "waits: waits: no heat for 3.0 s"


def test_drops_are_told_by_second() -> None:
    records = StageRecords()
    for second in range(9):
        drops = {"source/frame busy": 12 * second, "older": 3}
        records.receive(health("proposals", received=30 * second, drops=drops), float(second))
    assert said(records, "proposals", 8.0) == "waits: drops 12 of 30 a second: source/frame busy"
    assert records.drops() == {"proposals": {"source/frame busy": 96, "older": 3}}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"state": "another fusion answers too: end one"}, "bad: another fusion answers too: end one"),
        ({"errors": 1, "last_error": "it broke"}, "bad: fails: it broke"),
        ({"latency_ms_p50": 850.0}, "waits: is 0.8 s behind the camera"),
        ({"latency_ms_p50": None, "step_ms_p50": None}, "good: 30 a second"),
        ({"pid": 2, "drops": {"no heat": 50}}, "good: 30 a second, 8 ms per step, 40 ms behind the camera"),
    ],
)
def test_what_one_message_says(changes: dict[str, Any], expected: str) -> None:
    records = working(8)
    records.receive(health("fusion", **changes), 9.0)
    assert said(records, "fusion", 9.0) == expected


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"pid": 1}, {"pid": 2}),
        # In a container a restarted stage has the pid of the one before.
        ({"header": header("one")}, {"header": header("two")}),
        ({"uptime_s": 60.0}, {"uptime_s": 1.0}),
    ],
)
def test_errors_of_a_restarted_stage_are_not_compared_with_those_before(
    before: dict[str, Any], after: dict[str, Any]
) -> None:
    records = StageRecords()
    records.receive(health("fusion", **before, errors=50, last_error="old trouble"), 0.0)
    for second in (1, 2):
        records.receive(health("fusion", **after, errors=second, last_error="each frame fails"), float(second))
    assert said(records, "fusion", 2.0) == "bad: fails: each frame fails"


def test_a_lost_pose_is_told_of_the_pose_stage() -> None:
    assert said(working(8), "pose", 8.0, lost="too few points") == "bad: is lost: too few points"


def test_a_stage_that_is_gone_after_the_last_objects_has_done_its_work() -> None:
    records = working(8)
    records.words(STAGES, 8.0)
    assert [word.level for word in records.words((), 8.5)] == ["bad"] * len(STAGES)
    ended = records.words(("fusion",), 8.5, complete=True)
    assert [f"{word.stage}: {word.text}" for word in ended if word.level == "ended"] == [
        f"{stage}: has ended" for stage in STAGES if stage != "fusion"
    ]


def test_who_is_no_stage_is_not_listened_to() -> None:
    records = StageRecords()
    records.receive(health("stranger"), 1.0)
    assert [word.stage for word in records.words((), 1.0)] == list(STAGES)


def test_a_bridge_is_told_of_where_there_is_one() -> None:
    """As `spot3d status` does; what it skips on purpose is no fault."""
    both = (*STAGES, BRIDGE)
    records = working(8)
    assert BRIDGE not in [word.stage for word in records.words(STAGES, 8.0)]
    assert said(records, BRIDGE, 8.0, both) == "waits: is running, but has not published its health yet"
    for second in range(9):
        skipped = {"heatmap/heat skipped": 25 * second}
        records.receive(health(BRIDGE, published=92 * second, drops=skipped, rate_hz=0.0), float(second))
    assert said(records, BRIDGE, 8.0, both) == "good: passes on 92 messages a second"
    assert records.drops() == {BRIDGE: {"heatmap/heat skipped": 200}}
    cut = "no messages to tcp/10.0.0.2:7447 for 5 s: no answer"
    records.receive(health(BRIDGE, state=cut), 9.0)
    assert said(records, BRIDGE, 9.0, both) == f"bad: {cut}"
    assert said(records, BRIDGE, 14.0, both).startswith("bad: has sent nothing for 5 s")
    assert said(records, BRIDGE, 14.0) == "bad: has not answered for 5 s: it hangs, or the link to it is cut"
