import io

import numpy as np
import pytest
from rich.console import Console

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.run.demo import demo_table, match_objects


def box(x: float, size: float = 0.1) -> Box3D:
    return Box3D(np.array([x, 0.0, 0.0]), np.full(3, size), np.eye(3))


def found(number: int, x: float) -> FoundObject:
    return FoundObject(number, box(x), 0.5, 10, 100)


@pytest.mark.parametrize(
    ("true", "seen", "ids", "verdicts", "further", "strangers"),
    [
        ([], [], [], [], [], []),
        ([], [found(1, 0)], [], [], [], [1]),
        ([("mug", box(0))], [], [None], [False], [], []),
        ([("mug", box(0)), ("box", box(1))], [found(4, 0.01), found(5, 3)], [4, None], [True, False], [], [5]),
        ([("mug", box(0))], [found(4, 0.09)], [4], [False], [], [4]),
        ([("mug", box(0))], [found(4, 0.05), found(5, -0.04)], [5], [True], [4], []),
    ],
)
def test_matches(true, seen, ids, verdicts, further, strangers):
    matches, halves, others = match_objects(true, seen)
    assert [match.found_id for match in matches] == ids
    assert [match.found for match in matches] == verdicts
    assert [item.id for item in halves] == further
    assert [item.id for item in others] == strangers
    text = io.StringIO()
    Console(file=text, width=80).print(demo_table(matches, halves, others))
    assert all(name in text.getvalue() for name, _ in true)
    said = " ".join(text.getvalue().replace("│", " ").split())
    assert "found: 3D IoU of 0.25 or more" in said
    assert f"further boxes of an object {len(further)}" in said
