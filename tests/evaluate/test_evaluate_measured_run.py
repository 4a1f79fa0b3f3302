"""What a run over a labelled sequence is measured by, beside its objects."""

from dataclasses import replace

import numpy as np
import pytest

from spot3d.evaluate.degraded import Degradation
from spot3d.evaluate.labelled import LabelledSequence
from spot3d.evaluate.measured_run import measure
from spot3d.settings import Settings
from spot3d.source.scene.scene import Scene
from spot3d.source.sequence import FrameList


def test_a_run_tells_how_far_off_its_cameras_are_and_how_many_frames_are_lost() -> None:
    """Every other frame of the second half is dark, and a quarter of a second is lost; the rest is followed."""
    seen = list(Degradation(half=True).of(Scene(2, frames=24)))
    blank = [replace(frame, depth=np.zeros_like(frame.depth)) for frame in seen]
    frames = FrameList([blank[i] if i >= 12 and i % 2 else frame for i, frame in enumerate(seen)])
    run = measure(LabelledSequence("dark", frames, None), Settings().changed("pose", provider="kiss"))
    assert run.lost == pytest.approx(6 / 24)
    assert 0 < run.ate < 0.005


def test_given_poses_are_as_far_off_as_they_are() -> None:
    sequence = Degradation(half=True, metres=0.02, degrees=0.0).of(Scene(2, frames=24))
    settings = Settings().changed("pose", provider="given", given_sigma=0.0)
    run = measure(LabelledSequence("shaken", sequence, None), settings)
    assert run.lost == 0
    assert 0.01 < run.ate < 0.05
