"""The status says how many objects there are, and what was left out."""

import io

import numpy as np
import pytest
from rich.console import Console

from spot3d.fusion.objects.reasons import REASONS
from spot3d.run.status import status_table
from spot3d_schemas import STAGES, Header, Objects


def said_of(left_out: dict[str, int]) -> str:
    """The text below the table."""
    objects = Objects(
        header=Header(robot="robot", seq=0, stamp_ns=1, frame_id="camera"),
        objects=(),
        up=np.array([0.0, 0.0, 1.0]),
        frame_count=30,
        map_points=1000,
        map_limit_reached=False,
        complete=False,
        left_out=left_out,
    )
    text = io.StringIO()
    Console(file=text, width=80).print(status_table("robot", dict.fromkeys(STAGES, True), {}, objects))
    lines = text.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    return " ".join(" ".join(lines).split()).partition("objects: ")[2]


@pytest.mark.parametrize(
    ("left_out", "said"),
    [({}, "0"), ({"too large": 3, "too cold": 2}, "0; left out: 3 too large, 2 too cold")],
)
def test_objects_are_told_below_the_table(left_out: dict[str, int], said: str) -> None:
    assert said_of(left_out) == said


def test_all_reasons_fit_a_terminal() -> None:
    said = said_of(dict.fromkeys(REASONS, 1000))
    assert all(f"1000 {reason}" in said for reason in REASONS)
