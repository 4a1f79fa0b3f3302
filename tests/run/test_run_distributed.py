"""A run's own watch over its stages, and how it goes on after a restart of its source."""

from collections import Counter
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import pytest
from schemas_samples import SAMPLES

from spot3d.run import distributed
from spot3d.run.display import RunMonitor
from spot3d.run.distributed import Plan
from spot3d.run.report import RunReport
from spot3d.settings import load_settings
from spot3d.source.selected import Selection


def test_objects_that_do_not_come_are_told_with_where_to_look(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distributed, "_FINAL_OBJECTS_S", -1.0)
    progress = SAMPLES["Progress"].model_copy(update={"fused": 3})
    collector = SimpleNamespace(
        progress=progress,
        objects=None,
        stream="s",
        drain=lambda: None,
        news=list,
        latest=dict,
        counts=lambda: (3, Counter()),
    )
    supervisor = SimpleNamespace(poll=lambda _: [], processes=dict, children={"source": SimpleNamespace(finished=True)})
    watcher = SimpleNamespace(on_progress=lambda *_: None)
    report, plan = RunReport("scene", "processes", 3, (1, 1)), Plan(Selection("scene", 3), load_settings(), tmp_path)
    monitor = RunMonitor(report, SimpleNamespace(), watcher, Event())
    distributed._follow(plan, "", supervisor, collector, monitor, pytest.fail)
    assert report.error.startswith("the last update of the objects did not come within ")
    assert report.error.endswith(f" s; see {tmp_path / 'logs' / 'fusion.log'}")


def test_stages_that_compile_their_kernels_are_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distributed, "_SLOW_START_S", -1.0)
    rounds, stop, said = iter(range(3)), Event(), list[str]()

    def drain() -> None:
        if next(rounds) == 2:
            stop.set()

    health = {"pose": SAMPLES["Health"].model_copy(update={"stage": "pose"})}
    collector = SimpleNamespace(progress=None, drain=drain, news=list, latest=lambda: health)
    running = dict.fromkeys(("source", "pose", "segments", "fusion"), 1)
    supervisor = SimpleNamespace(
        poll=lambda _: [],
        processes=lambda: running,
        children={"source": SimpleNamespace(finished=False)},
        end=lambda _: None,
    )
    watcher = SimpleNamespace(on_note=said.append)
    report, plan = RunReport("scene", "processes", 3, (1, 1)), Plan(Selection("scene", 3), load_settings(), tmp_path)
    monitor = RunMonitor(report, SimpleNamespace(), watcher, stop)
    distributed._follow(plan, "", supervisor, collector, monitor, pytest.fail)
    assert said == ["waiting for fusion, segments; the first run compiles their kernels"]


@pytest.mark.parametrize(
    ("progress", "unsent", "told"),
    [
        (None, {}, []),
        # Fusion was started again, and knows of three frames; seven of ten had been sent.
        ({"fused": 2, "skipped": {"no heat": 1}, "last_stamp_ns": 70}, {}, ["--after-ns", "70", "--sent", "7"]),
        ({"fused": 2, "skipped": {}, "last_stamp_ns": 70}, {"cannot be read": 2}, ["--after-ns", "70", "--sent", "5"]),
    ],
)
def test_a_source_that_is_started_again_is_told_how_many_frames_were_sent(
    progress: dict[str, Any] | None, unsent: dict[str, int], told: list[str], tmp_path: Path
) -> None:
    stamps_ns = range(10, 110, 10)
    said = None if progress is None else SAMPLES["Progress"].model_copy(update=progress)
    plan = Plan(Selection("recording"), load_settings(), tmp_path, stamps_ns=stamps_ns)
    collector = SimpleNamespace(stream="s", progress=said, unsent=lambda: Counter(unsent))
    arguments = distributed._source_again(plan, "tcp/127.0.0.1:1", collector)
    assert arguments[0] == "recording"
    _, _, after = " ".join(arguments).partition("--stream s")
    assert after.split() == told


def test_a_source_of_a_camera_is_told_what_fusion_has_accounted_for(tmp_path: Path) -> None:
    progress = SAMPLES["Progress"].model_copy(update={"fused": 5, "skipped": {"no pose": 1}, "last_stamp_ns": 70})
    collector = SimpleNamespace(stream="s", progress=progress, unsent=Counter)
    plan = Plan(Selection("realsense"), load_settings(), tmp_path)
    assert distributed._source_again(plan, "tcp/127.0.0.1:1", collector)[-2:] == ["--sent", "6"]
