"""The map is asked for again while fusion refuses it, and what is missing in the end is told."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest
import zenoh
from schemas_samples import SAMPLES

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.run import distributed, from_messages
from spot3d.run.collector import Collector
from spot3d.run.display import RunMonitor
from spot3d.run.from_messages import NoMapError, asked_map
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.report import RunReport
from spot3d_schemas import encode, key

ROBOT, BUSY = "asked-for-its-map", "too many requests for the map; ask again in a second"
WHERE = key(ROBOT, "fusion/map")
MAP = SAMPLES["MapPoints"].model_copy(update={"header": SAMPLES["MapPoints"].header.model_copy(update={"stream": "a"})})
LIMIT_S = 20.0

Answer = Callable[[zenoh.Query], object]


def refuse(query: zenoh.Query) -> None:
    query.reply_err(BUSY.encode())


def give(query: zenoh.Query) -> None:
    query.reply(WHERE, encode(MAP))


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with open_router((free_loopback_endpoint(),)) as session:
        yield session


@contextmanager
def fusion(session: zenoh.Session, *answers: Answer) -> Iterator[list[float]]:
    """Answers queries in turn, the last answer from then on. Yields when each came."""
    asked_s: list[float] = []

    def answer(query: zenoh.Query) -> None:
        asked_s.append(time.monotonic())
        with query:
            answers[min(len(asked_s), len(answers)) - 1](query)

    queryable = session.declare_queryable(WHERE, answer, complete=True)
    try:
        yield asked_s
    finally:
        queryable.undeclare()


def test_a_map_that_is_refused_is_asked_for_again(session: zenoh.Session) -> None:
    with fusion(session, refuse, refuse, give) as asked_s:
        assert asked_map(session, ROBOT, LIMIT_S, "a").total == MAP.total
    assert len(asked_s) == 3


@pytest.mark.parametrize(
    ("answer", "stream", "expected"),
    [
        (refuse, "a", f"fusion refuses: {BUSY}"),
        (give, "b", "fusion is in another stream"),
        (lambda query: query.reply(WHERE, b"no map"), "a", "fusion's answer is no valid map"),
        (lambda query: query.reply_err(b"\xff\x1b[31m" * 1000), "a", "fusion refuses: \ufffd\\x1b[31m"),
        (lambda _: None, "a", "fusion does not answer"),
    ],
)
def test_why_there_is_no_map_is_told(answer: Answer, stream: str, expected: str, session: zenoh.Session) -> None:
    with fusion(session, answer), pytest.raises(NoMapError) as told:
        asked_map(session, ROBOT, 1.2, stream)
    assert str(told.value).startswith(expected)
    assert len(str(told.value)) < 2000


def test_a_fusion_that_does_not_answer_ends_the_wait(session: zenoh.Session) -> None:
    kept: list[zenoh.Query] = []
    queryable = session.declare_queryable(WHERE, kept.append, complete=True)
    began_s = time.monotonic()
    with pytest.raises(NoMapError, match="fusion does not answer"):
        asked_map(session, ROBOT, 1.0, "a")
    assert 0.9 < time.monotonic() - began_s < LIMIT_S
    for query in kept:
        query.drop()
    queryable.undeclare()


def test_a_run_without_its_final_map_says_so(
    session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(distributed, "_MAP_S", 1.0)
    monkeypatch.setattr(from_messages, "_AGAIN_S", 0.1)
    told: list[str] = []
    report = RunReport("scene", "processes", 3, (1, 1))
    with GrowingFiles(tmp_path) as files, Collector(session, ROBOT, "a", files) as collector:
        monitor = RunMonitor(report, files, SimpleNamespace(on_event=told.append), Event())
        collector.progress = SAMPLES["Progress"]
        with fusion(session, give):
            assert distributed._last_map(collector, monitor).total == MAP.total
        assert not told
        with fusion(session, refuse):
            assert distributed._last_map(collector, monitor).total == MAP.total
    assert told == [f"no final map: fusion refuses: {BUSY}; heatmap.ply has an earlier one, of {MAP.total} points"]
    assert report.events == told
