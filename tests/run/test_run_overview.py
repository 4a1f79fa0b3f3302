from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import zenoh
from dataflow_stages import Recording, frame_message

from spot3d.run import overview
from spot3d.run.overview import MOST, OverviewFrames
from spot3d_schemas import encode


def test_frames_are_kept_from_all_along_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a camera of 30 Hz, for half an hour."""
    shot, now_ns = Recording(1)[0], 0

    def latest(*_: object) -> SimpleNamespace:
        payload = encode(frame_message(replace(shot, stamp_ns=now_ns), "robot", 0))
        return SimpleNamespace(sample=SimpleNamespace(payload=zenoh.ZBytes(payload)), close=lambda: None)

    monkeypatch.setattr(overview, "OneSample", latest)
    seen = OverviewFrames("robot")
    assert seen.image == (0, 0)
    for number in range(30 * 60 * 30):
        now_ns = round(number * 1e9 / 30)
        seen.pose(now_ns, np.eye(4))
        seen.look(None, None, 1e-9 * now_ns)
        assert len(seen.views) <= MOST
    assert seen.image == (160, 120)
    stamps = [frame.stamp_ns for frame, _ in seen.views]
    gaps = np.diff([*stamps, now_ns])
    assert len(stamps) > MOST // 2 - 1
    assert stamps[0] == 0
    assert gaps.max() < 2 * gaps[:-1].min()
