import io
from contextlib import ExitStack

import pytest
from rich.console import Console

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.run.status import _Robot, show_status, status_table
from spot3d_schemas import BRIDGE, STAGES, Header, Health, alive_key, encode, encoding, key
from waiting import wait_until


def health(stage: str, drops: dict[str, int], step: float | None) -> Health:
    return Health(
        header=Header(robot="robot", seq=0, stamp_ns=1, frame_id=stage),
        stage=stage,
        pid=1,
        uptime_s=1.0,
        received=10,
        published=9,
        drops=drops,
        events={},
        errors=1 if drops else 0,
        last_error="it broke [oddly]" if drops else "",
        rate_hz=None if step is None else 29.97,
        latency_ms_p50=step,
        latency_ms_p99=step,
        step_ms_p50=step,
        step_ms_p99=step,
        cpu_s=1.0,
        rss_bytes=200 * 2**20,
        threads=9,
    )


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({}, ("source", "no", "-")),
        ({"pose": health("pose", {}, None)}, ("pose", "200")),
        ({"fusion": health("fusion", {"no heat": 3}, 12.34)}, ("30.0", "12.3 / 12", "3 no heat", "it broke [oddly]")),
    ],
)
def test_status_fits_a_terminal(known, said):
    text = io.StringIO()
    alive = {stage: stage in known for stage in STAGES}
    Console(file=text, width=80).print(status_table("robot", alive, known))
    for part in said:
        assert part in text.getvalue()
    assert all(stage in text.getvalue() for stage in STAGES), "no name is cut"
    assert max(map(len, text.getvalue().splitlines())) <= 80


def test_a_bridge_has_a_row() -> None:
    text = io.StringIO()
    alive = dict.fromkeys((*STAGES, BRIDGE), 1)
    cut = health(BRIDGE, {"late": 4}, None).model_copy(update={"state": "no messages to tcp/10.0.0.2:7447"})
    Console(file=text, width=80).print(status_table("robot", alive, {BRIDGE: cut}))
    assert "bridge dropped: 4 late" in text.getvalue()
    assert "bridge: no messages to tcp/10.0.0.2:7447" in text.getvalue()


@pytest.mark.parametrize(
    ("drops", "streams", "told"), [({"late": 2}, 2, True), ({"late": 2}, 1, False), ({}, 2, False)]
)
def test_counts_that_are_of_earlier_streams_as_well_are_told(drops: dict[str, int], streams: int, told: bool) -> None:
    text = io.StringIO()
    known = {"pose": health("pose", drops, 1.0).model_copy(update={"events": {"streams": streams}})}
    Console(file=text, width=80).print(status_table("robot", dict.fromkeys(STAGES, 1), known))
    line = "dropped and errors: since each stage's start, so of earlier streams as well\n"
    assert (line in text.getvalue()) == told


@pytest.mark.parametrize(("rates", "told"), [((0.0, 0.0), True), ((0.0, 10.0), False), ((None, 0.0), False)])
def test_that_no_frame_comes_is_told(rates: tuple[float | None, float | None], told: bool) -> None:
    """A camera program of one's own says nothing of itself when it stops sending."""
    text = io.StringIO()
    known = {
        stage: health(stage, {}, 1.0).model_copy(update={"rate_hz": rate})
        for stage, rate in zip(("pose", "proposals"), rates, strict=True)
    }
    Console(file=text, width=80).print(status_table("robot", dict.fromkeys(STAGES, 1), known))
    assert ("pose, proposals received no frame in the last second" in text.getvalue()) == told


def test_health_that_names_another_stage_than_its_key_is_ignored() -> None:
    """Invented names would be kept for ever, and one with a state would make all look bad."""
    endpoint, text = free_loopback_endpoint(), io.StringIO()
    with open_router((endpoint,)) as session, ExitStack() as stack:
        asking = stack.enter_context(open_session(LinkSettings(connect=(endpoint,))))
        robot = _Robot(asking, "named", stack)

        def put(topic: str, message: Health) -> None:
            session.put(key("named", f"{topic}/health"), encode(message), encoding=encoding(Health))

        def has_heard(stage: str) -> bool:
            put("pose", health("invented", {}, None).model_copy(update={"state": "all is wrong"}))
            put("pose", health("fusion", {}, None).model_copy(update={"state": "fusion is wrong"}))
            put("heatmap", health("heatmap", {}, None))
            robot.listen(0.1)
            return stage in robot._health

        wait_until(lambda: has_heard("heatmap"), "heatmap is heard", 20.0)
        robot.listen(0.1)
        Console(file=text, width=80).print(robot.table(), robot.words())
        assert set(robot._health) == {"heatmap"}
    assert "is wrong" not in text.getvalue()


@pytest.mark.parametrize(("robot", "said"), [("drone", None), ("drome", "alive here: drone; choose one with --robot")])
def test_who_asks_for_a_robot_that_is_not_there_is_told_who_is(robot: str, said: str | None) -> None:
    endpoint, text = free_loopback_endpoint(), io.StringIO()
    with open_router((endpoint,)) as session, session.liveliness().declare_token(alive_key("drone", "pose")):
        link = LinkSettings(connect=(endpoint,), robot=robot)
        assert not show_status(link, Console(file=text, width=80), watch=False)
    assert (said in text.getvalue()) if said else "alive here" not in text.getvalue()


def test_who_asks_where_no_robot_is_is_told_so() -> None:
    endpoint, text = free_loopback_endpoint(), io.StringIO()
    with open_router((endpoint,)):
        assert not show_status(LinkSettings(connect=(endpoint,)), Console(file=text, width=80), watch=False)
    assert "no robot is alive here" in text.getvalue()
