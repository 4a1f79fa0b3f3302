"""When a stage that says nothing hangs, and when it is only slow, late, or not heard."""

from spot3d.run.silence import SILENT_S, START_S, Silence
from spot3d_schemas import Header, Health

LOOK_S = 0.05
INTERVAL_S = 1.0
LATE_S = SILENT_S + INTERVAL_S


def said(stage: str, pid: int) -> Health:
    unknown = dict.fromkeys(("rate_hz", "latency_ms_p50", "latency_ms_p99", "step_ms_p50", "step_ms_p99"))
    none = dict.fromkeys(("received", "published", "errors", "rss_bytes"), 0)
    header = Header(robot="robot", seq=0, stamp_ns=1, frame_id=stage)
    used = {"uptime_s": 1.0, "drops": {}, "events": {}, "last_error": "", "cpu_s": 0.0, "threads": 1}
    return Health(header=header, stage=stage, pid=pid, **none, **unknown, **used)


class Clocked:
    """A run that looks twenty times a second."""

    def __init__(self) -> None:
        self.silence = Silence(INTERVAL_S)
        self.now_s = 0.0
        self.processes = {"segments": 1, "fusion": 2}
        self.latest = {"segments": said("segments", 1), "fusion": said("fusion", 2)}

    def look(self) -> list[str]:
        return self.silence.look(self.latest, self.processes, self.now_s)

    def first_hang_s(self, limit_s: float, *heard: str) -> tuple[float, list[str]]:
        """When, from now on, a stage hangs, and which; those `heard` say something at each look."""
        began_s = self.now_s
        while not (hanging := self.look()) and self.now_s - began_s < limit_s:
            self.now_s += LOOK_S
            for stage in heard:
                self.latest[stage] = said(stage, self.processes[stage])
        return self.now_s - began_s, hanging


def test_a_stage_whose_health_is_too_late_hangs_and_no_other() -> None:
    after_s, hanging = Clocked().first_hang_s(60.0, "fusion")
    assert hanging == ["segments"]
    assert LATE_S < after_s < LATE_S + 1.0


def test_a_process_that_has_said_nothing_yet_is_waited_for() -> None:
    """It was started again, and compiles: what its stage said last is of the process before."""
    run = Clocked()
    run.processes["segments"] = 3
    assert run.first_hang_s(600.0, "fusion")[1] == []
    del run.processes["segments"]
    assert run.first_hang_s(60.0, "fusion")[1] == [], "it has ended"


def test_a_process_that_is_not_on_line_long_after_its_start_hangs_unless_it_reads_its_input() -> None:
    run = Clocked()
    run.processes |= {"segments": 3, "pose": 4, "source": 5}
    after_s, hanging = run.first_hang_s(2 * START_S, "fusion")
    assert hanging == ["segments", "pose"]
    assert START_S < after_s < START_S + INTERVAL_S + 1.0
    assert [run.silence.limit_s(stage) for stage in ("segments", "fusion")] == [START_S, SILENT_S]
    run.processes |= {"segments": 6, "pose": 7}
    run.now_s += LOOK_S
    assert run.look() == [], "they were started again"
    del run.processes["segments"], run.processes["pose"]
    assert run.first_hang_s(2 * START_S, "fusion")[1] == [], "a source is waited for"


def test_time_in_which_the_run_itself_stood_still_is_no_silence() -> None:
    run = Clocked()
    assert run.first_hang_s(5.0)[1] == []
    run.now_s += 3600.0  # Ctrl-Z
    assert run.first_hang_s(5.0)[1] == []
    assert run.first_hang_s(10.0, "segments", "fusion")[1] == []
    after_s, hanging = run.first_hang_s(60.0)
    assert hanging == ["segments", "fusion"]
    assert after_s > SILENT_S
