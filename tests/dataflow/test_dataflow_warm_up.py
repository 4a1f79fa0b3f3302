"""After the warm-up, frames of a real scene find every kernel loaded."""

import json
import logging
import subprocess
import sys
import threading

import pytest

from spot3d.dataflow.warm_up import warm_up

KERNELS_AFTER = """
import json, sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from spot3d.dataflow.warm_up import warm_up
from spot3d.source.halving import halve
from spot3d.source.scene.scene import Scene

frames = [halve(halve(frame)) for frame in Scene(frames=6)]

def loaded():
    kernels = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("spot3d."):
            for kernel in vars(module).values():
                if isinstance(kernel, Dispatcher):
                    kernels[kernel.py_func.__qualname__, kernel.py_func.__module__] = len(kernel.signatures)
    return kernels

def missing(stage, work):
    warm_up(stage, work)
    before = loaded()
    work(frames)
    after = loaded()
    return [list(name) for name, count in after.items() if count > before.get(name, 0)]

from spot3d.pose.process import track_all
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.proposals.process import _propose_first
from spot3d.proposals.settings import ProposalSettings
from spot3d.heatmap.process import _heat_first
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.segments.process import _find_first
from spot3d.segments.settings import SegmentsSettings
from spot3d.fusion.process import _fuse_all
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.settings import FusionSettings
odometry = missing("pose", lambda frames: track_all(make_tracker(PoseSettings()), frames))
odometry += [name for name, count in loaded().items() if name[1] == "spot3d.pose.plane_equations" and not count]
print(json.dumps({
    "pose": odometry,
    "given poses": missing("pose", lambda frames: track_all(make_tracker(PoseSettings(provider="given")), frames)),
    "proposals": missing("proposals", lambda frames: _propose_first(ProposalSettings(), frames)),
    "heatmap": missing("heatmap", lambda frames: _heat_first(HeatmapSettings(), frames)),
    "segments": missing("segments", lambda frames: _find_first(SegmentsSettings(), frames)),
    "fusion": missing("fusion", lambda frames: _fuse_all(Fusion(FusionSettings()), frames)),
    "objects": len(loaded()),
    "never": sorted(name for (name, module), count in loaded().items() if not count and "source" not in module),
}))
"""


def test_real_frames_find_every_kernel_loaded():
    done = subprocess.run(
        [sys.executable, "-c", KERNELS_AFTER], capture_output=True, text=True, timeout=180, check=False
    )
    assert done.returncode == 0, done.stderr
    missing = json.loads(done.stdout)
    assert missing.pop("objects") > 30, "the kernels are found at all"
    assert missing.pop("never") == [], "what not every frame calls has a signature"
    assert missing == {"pose": [], "given poses": [], "proposals": [], "heatmap": [], "segments": [], "fusion": []}


def test_a_core_that_fails_does_not_keep_its_stage_from_starting(caplog: pytest.LogCaptureFixture):
    def fail(frames: object) -> None:
        raise ZeroDivisionError("of the core")

    warm_up("pose", fail)
    assert "ZeroDivisionError: of the core" in caplog.text


def test_a_stage_that_compiles_for_long_says_so_meanwhile(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    """Else its log stays empty for minutes, and it looks as if it had not started."""
    said = threading.Event()

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if "compiling kernels" in record.getMessage():
                said.set()

    monkeypatch.setattr("spot3d.dataflow.warm_up._SLOW_S", 0.01)
    log, ear = logging.getLogger("spot3d.fusion"), Ear()
    caplog.set_level(logging.INFO, "spot3d.fusion")
    log.addHandler(ear)
    try:
        heard: list[bool] = []
        warm_up("fusion", lambda frames: heard.append(said.wait(20)))
    finally:
        log.removeHandler(ear)
    assert heard == [True]


FIRST_UPDATE = """
import json, sys
from spot3d.dataflow.warm_up import warm_up
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.process import _fuse_all
from spot3d.settings import load_settings
from spot3d.source.scene.scene import Scene

early = [name for name in ("sklearn", "scipy.optimize") if name in sys.modules]
settings = load_settings(preset=sys.argv[1]).fusion
warm_up("fusion", lambda frames: _fuse_all(Fusion(settings), frames))
scene, before = Scene(frames=3), set(sys.modules)
_fuse_all(Fusion(settings), [scene[index] for index in range(3)])
print(json.dumps([early, sorted(set(sys.modules) - before)]))
"""


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_the_first_update_loads_nothing(preset: str):
    """What finds the objects is loaded before the stage goes on line, and only what the settings call for."""
    words = [sys.executable, "-c", FIRST_UPDATE, preset]
    done = subprocess.run(words, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 0, done.stderr
    early, late = json.loads(done.stdout)
    assert early == [], "they take a second to import"
    assert late == []
