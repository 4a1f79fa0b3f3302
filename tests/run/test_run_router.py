"""Where a run is reached: at the usual endpoint if that is free, and where it must be."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from threading import Barrier

import pytest
import zenoh

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.run.display import Watcher
from spot3d.run.run_router import open_run_router
from spot3d.settings import load_settings

LIMIT_S = 20.0


@dataclass
class Told:
    notes: list[str] = field(default_factory=list)
    events: list[str] = field(default_factory=list)

    def watcher(self) -> Watcher:
        return Watcher(lambda *_: None, self.events.append, self.notes.append)


def reached(router: zenoh.Session, endpoint: str) -> bool:
    """Whether who connects there is at the run's own router."""
    with open_session(LinkSettings(connect=(endpoint,))) as session:
        return list(map(str, session.info.routers_zid())) == [str(router.info.zid())]


@pytest.mark.parametrize("apart", [True, False])
def test_others_reach_a_run_at_the_usual_endpoint(apart: bool) -> None:
    usual, told = free_loopback_endpoint(), Told()
    with open_run_router(load_settings(), (), usual, apart, told.watcher()) as (router, own):
        assert reached(router, usual)
        assert reached(router, own)
        assert own.startswith("unixsock-stream/") == apart
    assert (told.notes, told.events) == ([f"status, dashboard and record can reach this run at {usual}"], [])


@pytest.mark.parametrize("others", [0, 1])
def test_a_run_goes_without_the_usual_endpoint_where_that_is_taken(others: int) -> None:
    usual, told = free_loopback_endpoint(), Told()
    listen = tuple(free_loopback_endpoint() for _ in range(others))
    with (
        open_router((usual,)),
        open_run_router(load_settings(), listen, usual, True, told.watcher()) as (router, own),
    ):
        assert not reached(router, usual)
        assert all(reached(router, endpoint) for endpoint in (own, *listen))
        assert own.startswith("unixsock-stream/") == bool(listen), "only who can come is kept apart"
    assert (told.notes, told.events) == (
        [],
        [f"{usual} is in use: other programs can reach this run only at endpoints given with --listen"],
    )


def test_an_endpoint_that_was_asked_for_must_be_had() -> None:
    endpoint = free_loopback_endpoint()
    with open_router((endpoint,)), pytest.raises(ConnectionError, match=f"cannot listen at .*{endpoint}"):
        open_run_router(load_settings(), (endpoint,), None, True, Told().watcher()).__enter__()


def test_the_usual_endpoint_is_not_blamed_for_another_one() -> None:
    usual, elsewhere, told = free_loopback_endpoint(), "tcp/192.0.2.7:7448", Told()
    with pytest.raises(ConnectionError, match=f"cannot listen at .*{elsewhere}.* address of this device"):
        open_run_router(load_settings(), (elsewhere,), usual, True, told.watcher()).__enter__()
    assert (told.notes, told.events) == ([], [])


def test_of_runs_that_begin_at_once_one_has_the_usual_endpoint() -> None:
    usual, settings, told, runs = free_loopback_endpoint(), load_settings(), Told(), 4
    together = Barrier(runs)

    def begin(stack: ExitStack) -> None:
        together.wait(LIMIT_S)
        stack.enter_context(open_run_router(settings, (), usual, True, told.watcher()))

    with ExitStack() as stack, ThreadPoolExecutor(runs) as pool:
        stacks: Sequence[ExitStack] = [stack.enter_context(ExitStack()) for _ in range(runs)]
        for begun in [pool.submit(begin, own) for own in stacks]:
            begun.result(LIMIT_S)
    assert (len(told.notes), len(told.events)) == (1, runs - 1)
