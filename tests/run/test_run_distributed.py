"""A run's own watch over its stages."""

from collections import Counter
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest
from schemas_samples import SAMPLES

from spot3d.run import distributed
from spot3d.run.distributed import Plan
from spot3d.run.monitor import RunMonitor
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
    supervisor = SimpleNamespace(poll=lambda _: [], processes=dict, finished=lambda stage: stage == "source")
    watcher = SimpleNamespace(on_progress=lambda *_: None)
    report, plan = RunReport("scene", "processes", 3, (1, 1)), Plan(Selection("scene", 3), load_settings(), tmp_path)
    monitor = RunMonitor(report, SimpleNamespace(), watcher, Event())
    distributed._follow(plan, "", supervisor, collector, monitor, pytest.fail)
    assert report.error.startswith("the last update of the objects did not come in ")
    assert report.error.endswith(f" s; {tmp_path / 'logs' / 'fusion.log'} may say why")
