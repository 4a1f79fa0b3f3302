"""What a run's report says of its stages."""

import pytest

from spot3d.run.report import RunReport, StageReport


@pytest.mark.parametrize(
    ("p50", "errors", "said"),
    [
        (None, 2, "proposals failed whenever it was asked: odd"),
        (4.0, 2, ""),  # single frames
        (None, 0, ""),  # nobody asked it
    ],
)
def test_a_stage_that_only_failed_is_told(p50: float | None, errors: int, said: str) -> None:
    report = RunReport("scene", "processes", 3, (1, 1))
    report.stages["source"] = StageReport(step_ms={"p50": 1.0})
    report.stages["proposals"] = StageReport(step_ms={"p50": p50}, errors=errors, last_error="odd" if errors else "")
    assert report.useless_stage() == said
