"""A recording that has ended is no fault: status and doctor, of the stages that wait for the next one."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from typer.testing import CliRunner

from spot3d.cli.app import app
from spot3d.dataflow.node import Node
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import STAGES, Header, Objects

ROBOT = "ended"
GONE = [stage for stage in STAGES if stage != "source"]


@contextmanager
def stages(endpoint: str, there: list[str], complete: bool) -> Iterator[None]:
    """Real nodes of stages that have nothing to do any more, and what fusion has kept."""
    link = LinkSettings(robot=ROBOT, connect=(endpoint,), health_interval_s=0.2)
    with open_router((endpoint,)), ExitStack() as stack:
        for stage in there:
            outputs = ("fusion/objects",) if stage == "fusion" else ()
            node = stack.enter_context(Node(stage, link, threading.Event(), (), outputs))
            if outputs:
                header = Header(robot=ROBOT, seq=0, stamp_ns=1, frame_id="camera")
                numbers = {"frame_count": 9, "map_points": 9, "map_limit_reached": False}
                found = {"objects": (), "up": np.array([0.0, 0.0, 1.0]), "complete": complete}
                node.publish(
                    "fusion/objects", Objects(header=node.numbered("fusion/objects", header), **numbers, **found)
                )
        yield


def asked(command: str, there: list[str], complete: bool, *more: str) -> tuple[int, str]:
    """Exit code and words of a command."""
    endpoint = free_loopback_endpoint()
    arguments = [command, "--connect", endpoint, "--robot", ROBOT, *more]
    with stages(endpoint, there, complete):
        outcome = CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})
    return outcome.exit_code, outcome.output


@pytest.mark.parametrize(
    ("there", "complete", "code"),
    [(GONE, True, 0), (GONE, False, 1), ([name for name in GONE if name != "pose"], True, 1), (list(STAGES), False, 0)],
)
def test_status_ends_well_after_a_whole_recording(there: list[str], complete: bool, code: int) -> None:
    ended, said = asked("status", there, complete)
    assert ended == code, said
    over = complete and "source" not in there
    assert ("the recording has ended, and all of its frames are accounted for" in said) == over
    assert ("ended" in said.partition("source")[2].splitlines()[0]) == over
    assert ("objects: 0" in said) or not over, "what was found before anybody asked"


@pytest.mark.parametrize(("complete", "level"), [(True, "ok"), (False, "problem")])
def test_the_doctor_misses_no_source_after_a_whole_recording(complete: bool, level: str) -> None:
    code, said = asked("doctor", GONE, complete, "--seconds", "1.5")
    (line,) = [line for line in said.splitlines() if " stages: " in line]
    assert line.split()[0] == level
    assert ("the source has ended, as its recording is over" in line) == complete
    assert complete or "not alive: source" in line
    # Of this machine, which may have little room.
    problems = [line for line in said.splitlines() if line.startswith("problem")]
    assert code == bool(problems)
    assert all("disk" in line or "shared memory" in line or not complete for line in problems)
