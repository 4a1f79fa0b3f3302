"""What a stage counted is not lost when its process is started again."""

from spot3d.run.health_totals import HealthTotals
from spot3d_schemas import Header, Health


def said(pid: int, count: int, error: str = "") -> Health:
    """What a process says that has counted so many of everything."""
    return Health(
        header=Header(robot="robot", seq=0, stamp_ns=1, frame_id="fusion"),
        stage="fusion",
        pid=pid,
        uptime_s=1.0,
        received=10,
        published=9,
        drops={"no heat": count},
        events={"keyframes": count},
        errors=count,
        last_error=error,
        rate_hz=None,
        latency_ms_p50=None,
        latency_ms_p99=None,
        step_ms_p50=float(count),
        step_ms_p99=float(count),
        cpu_s=float(count),
        rss_bytes=count * 2**20,
        threads=1,
    )


def test_processes_are_added_up_each_with_what_it_said_last() -> None:
    totals = HealthTotals(said(1, 5))
    for health in (said(1, 7, "it broke"), said(2, 2), said(2, 3)):
        totals.add(health)
    report = totals.report(restarts=1)
    assert totals.drops() == {"no heat": 10}
    assert (report.events, report.errors, report.cpu_s) == ({"keyframes": 10}, 10, 10.0)
    assert report.last_error == "it broke", "the present process knows of none"
    assert (report.step_ms, report.rss_mb, report.restarts) == ({"p50": 3.0, "p99": 3.0}, 3.0, 1)
    totals.add(said(2, 4, "once more"))
    assert totals.report(1).last_error == "once more"


def test_times_of_a_step_stay_where_the_last_process_has_made_none() -> None:
    totals = HealthTotals(said(1, 5))
    totals.add(said(2, 1).model_copy(update={"step_ms_p50": None, "step_ms_p99": None}))
    assert totals.report(restarts=1).step_ms == {"p50": 5.0, "p99": 5.0}
