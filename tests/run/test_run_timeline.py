"""objects.jsonl keeps whole lines only, up to its limit, and counts what it lacks."""

import json
from pathlib import Path

import numpy as np

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.run.results import RunResult, found_in
from spot3d.run.timeline import Timeline

FOUND = RunResult(
    objects=(FoundObject(3, Box3D(np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.1, 0.2]), np.eye(3)), 0.5, 4, 100),),
    up=(0.0, 0.0, 1.0),
    frame_count=7,
)


def test_lines_come_back_and_the_limit_is_told(tmp_path: Path) -> None:
    path = tmp_path / "objects.jsonl"
    with Timeline(path) as timeline:
        timeline.add_update(5, FOUND, complete=False)
        timeline.add_update(6, FOUND, complete=True)
        assert timeline.told() is None
    whole = path.read_bytes()
    documents = [json.loads(line) for line in whole.splitlines()]
    assert [(item["stamp_ns"], item["complete"]) for item in documents] == [(5, False), (6, True)]
    back = found_in(documents[0])
    assert (back.up, back.frame_count, back.objects[0].id) == (FOUND.up, 7, 3)
    assert (back.objects[0].box.centre == FOUND.objects[0].box.centre).all()

    with Timeline(path, limit_bytes=len(whole) - 1) as timeline:
        for stamp_ns in (5, 6, 7):
            timeline.add_update(stamp_ns, FOUND, complete=False)
        assert timeline.told() == f"objects.jsonl is at its limit of {len(whole) - 1} bytes: it lacks 2 updates"
    assert len(path.read_text().splitlines()) == 1
