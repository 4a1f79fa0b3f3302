"""What a run's report says of its stages."""

import pytest

from spot3d.run.report import UNACCOUNTED, RunReport, StageReport


@pytest.mark.parametrize(
    ("p50", "errors", "said"),
    [
        (None, 2, "proposals failed on every frame: odd"),
        (4.0, 2, ""),  # single frames
        (None, 0, ""),  # nobody asked it
    ],
)
def test_a_stage_that_only_failed_is_told(p50: float | None, errors: int, said: str) -> None:
    report = RunReport("scene", "processes", 3, (1, 1))
    report.stages["source"] = StageReport(step_ms={"p50": 1.0})
    report.stages["proposals"] = StageReport(step_ms={"p50": p50}, errors=errors, last_error="odd" if errors else "")
    assert report.useless_stage() == said


@pytest.mark.parametrize(
    ("skipped", "said"),
    [
        ({}, "none was received"),
        ({"lost pose": 9, "no heat": 0}, "9 lost pose"),
        ({"no pose": 9}, "9 no pose"),
        ({"no pose": 9, "no heat": 8}, "9 no pose, 8 no heat; poses must have the stamp_ns of their frames"),
    ],
)
def test_why_no_frame_was_fused_is_told(skipped: dict[str, int], said: str) -> None:
    report = RunReport("scene", "processes", 9, (64, 48), skipped=skipped)
    assert report.nothing_fused() == f"no frame was fused: {said}"


@pytest.mark.parametrize(
    ("fused", "skipped", "interrupted", "said"),
    [
        (9, {}, False, "none dropped"),
        (7, {"no heat": 2, "no pose": 0}, False, "not fused: 2 no heat"),
        (7, {"no heat": 1}, False, "not fused: 1 no heat, 1 not reached"),
        (3, {}, True, "interrupted; not fused: 6 not reached"),
        (9, {}, True, "interrupted; none dropped"),
    ],
)
def test_what_was_not_fused_is_told(fused: int, skipped: dict[str, int], interrupted: bool, said: str) -> None:
    report = RunReport("scene", "processes", 9, (1, 1), fused=fused, skipped=skipped, interrupted=interrupted)
    assert report.not_fused() == said


@pytest.mark.parametrize("skipped", [{}, {"no heat": 1}, {"no heat": 2}])
def test_every_frame_of_an_input_that_was_played_is_accounted_for(skipped: dict[str, int]) -> None:
    report = RunReport("scene", "processes", 9, (1, 1), fused=7, skipped=dict(skipped))
    report.close()
    assert report.fused + sum(report.skipped.values()) == report.played
    assert report.skipped.get(UNACCOUNTED, 0) == 2 - sum(skipped.values())


def test_frames_that_a_source_tried_twice_to_play_count_once() -> None:
    """Killed amid four unreadable frames of ten, it was started again before them."""
    report = RunReport("scene", "processes", 10, (1, 1), fused=5, skipped={"no pose": 1, "cannot be read": 7})
    report.close()
    assert report.skipped == {"no pose": 1, "cannot be read": 4}
