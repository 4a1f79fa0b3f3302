"""Either side of a bridge knows which stages are alive on the other, and in which processes."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
import zenoh

from spot3d.bridge import flow
from spot3d.bridge.flow import TokenMirror
from spot3d.dataflow.alive import watch_alive
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d_schemas import alive_key, process_key
from waiting import wait_until

ROBOT = "mirrored"


@pytest.fixture
def sides() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    """The routers of both sides, which nothing joins but what a test does."""
    with open_router((free_loopback_endpoint(),)) as origin, open_router((free_loopback_endpoint(),)) as target:
        yield origin, target


def test_stages_and_their_processes_cross(sides: tuple[zenoh.Session, zenoh.Session]) -> None:
    origin, target = sides
    with ExitStack() as stack:
        alive = stack.enter_context(watch_alive(target, ROBOT))
        stack.callback(TokenMirror(origin, target, ROBOT, lambda stage: stage == "pose").stop)
        keys = (
            alive_key(ROBOT, "pose"),
            process_key(ROBOT, "pose", "pose-1"),
            process_key(ROBOT, "pose", "pose-2"),
            process_key(ROBOT, "fusion", "fusion-1"),  # of a stage on the other side
            process_key("another", "pose", "pose-3"),
        )
        tokens = [origin.liveliness().declare_token(where) for where in keys]
        wait_until(lambda: "pose" in alive and alive.processes("pose") == {"pose-1", "pose-2"})
        tokens[1].undeclare()
        wait_until(lambda: alive.processes("pose") == {"pose-2"})
        assert not alive.processes("fusion")


def test_tokens_that_anybody_declares_are_mirrored_up_to_a_limit(
    sides: tuple[zenoh.Session, zenoh.Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flow, "_TOKENS", 3)
    origin, target = sides
    mirrored = list[str]()
    with ExitStack() as stack:
        where = f"{alive_key(ROBOT, '*')}/**"

        def note(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                mirrored.append(str(sample.key_expr).rpartition("/")[2])

        stack.callback(target.liveliness().declare_subscriber(where, note).undeclare)
        stack.callback(TokenMirror(origin, target, ROBOT, lambda stage: True).stop)
        tokens = [origin.liveliness().declare_token(process_key(ROBOT, "pose", f"pose-{k}")) for k in range(6)]
        wait_until(lambda: len(mirrored) >= 3)
        tokens[0].undeclare()
        tokens.append(origin.liveliness().declare_token(process_key(ROBOT, "pose", "last")))
        # They come in their order: with the last one there, all of the others have been looked at.
        wait_until(lambda: "last" in mirrored)
        assert mirrored == ["pose-0", "pose-1", "pose-2", "last"]
