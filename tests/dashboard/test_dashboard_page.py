"""Which robots the page knows: those that are alive, and of those that are gone as many as there is room for."""

from collections.abc import Iterator
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

pytest.importorskip("viser", reason="the dashboard's packages are not installed")

import numpy as np
import viser
import zenoh
from schemas_samples import BOX, SAMPLES

from spot3d.dashboard.link import ROBOTS_MAX, Heard, Link
from spot3d.dashboard.page import Page
from spot3d.dashboard.process import open_server
from spot3d.dashboard.settings import DashboardSettings
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import encode, key

POSE = SAMPLES["Pose"].model_copy(update={"status": "ok", "reason": "", "T_world_camera": np.eye(4)})
NAMES = [f"drone-{number:02}" for number in range(ROBOTS_MAX)]


class Fleet(Link):
    """A link that hears what it is told here."""

    def __init__(self) -> None:
        super().__init__(LinkSettings(), 1.0)
        self.connected = True
        self.heard: list[Heard] = []

    def drain(self) -> Iterator[Heard]:
        heard, self.heard = self.heard, []
        yield from heard

    def has(self, *names: str) -> None:
        self.alive = {name: frozenset(("pose",)) for name in names}


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    with open_server(DashboardSettings(port=0, points_max=1000)) as server:
        yield server


def test_a_robot_too_many_takes_the_place_of_the_one_that_is_gone_the_longest(server: viser.ViserServer) -> None:
    fleet = Fleet()
    page = Page(server, fleet, DashboardSettings(points_max=1000), "tcp/a:1", always=False)
    try:
        first, second, *others = NAMES
        fleet.has(*NAMES)
        page.step(first=second)
        fleet.heard = [(second, "pose/pose", POSE)]
        page._slow_s = page._quick_s = 0.0
        page.step()
        fleet.has(first, *others)
        fleet._cursors = {second: (7, 100)}
        page.step()
        fleet.has(*others)
        page.step()
        assert set(page._robots) == {*NAMES}, "who is gone stays, with what it found"
        assert server.scene.get_handle_by_name(f"/{second}") is not None
        fleet.has(*others, "late")
        page.step()
        assert set(page._robots) == {first, *others, "late"}
        assert server.scene.get_handle_by_name(f"/{second}") is None
        assert not fleet._cursors, "when it comes back, its whole map is asked for"
        fleet.has(*others, "late", "later")
        page.step()
        assert set(page._robots) == {*others, "late", "later"}
        fleet.has(*others, "late", "later", second)
        page._slow_s = 0.0
        page.step()
        assert set(page._robots) == {*others, "late", "later"}, "none is gone"
        assert "17 robots are running; only the first 16 are shown" in page._panel.waiting._said
    finally:
        page.close()


def test_the_object_that_is_clicked_is_marked_though_the_page_stands_still(server: viser.ViserServer) -> None:
    fleet = Fleet()
    page = Page(server, fleet, DashboardSettings(points_max=1000), "tcp/a:1", always=False)
    try:
        first, second = BOX, BOX.model_copy(update={"id": BOX.id + 1})
        fleet.has("drone")
        fleet.heard = [
            ("drone", "pose/pose", POSE),
            ("drone", "fusion/objects", SAMPLES["Objects"].model_copy(update={"objects": (first, second)})),
        ]
        page.step()
        page._choose(None, "drone", first.id)
        page._quick_s = 0.0
        page.step()
        page._panel._paused.value = True
        page._choose(None, "drone", second.id)
        page.step()
        assert [said.startswith("> ") for _, said in page._panel._rows] == [False, True]
        boxes = page._scenes["drone"]._boxes
        assert boxes[second.id]._edges.thickness > boxes[first.id]._edges.thickness
    finally:
        page.close()


def test_views_are_moved_anew_where_the_first_objects_turn_the_world(
    server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet, ups = Fleet(), []
    page = Page(server, fleet, DashboardSettings(points_max=1000), "tcp/a:1", always=False)
    monkeypatch.setattr(server, "get_clients", lambda: {0: None})

    def looked(_look: object, _client: None) -> Future[None]:
        ups.append(page._scenes["drone"].R_view_world[2])
        return Future()

    monkeypatch.setattr(page._flights, "submit", looked)
    objects = SAMPLES["Objects"].model_copy(update={"up": np.array((0.0, 0.0, -1.0))})
    fleet.has("drone")
    for heard in (("pose/pose", POSE), ("fusion/objects", objects), ("fusion/objects", objects)):
        fleet.heard = [("drone", *heard)]
        page._quick_s = 0.0
        page.step()
    page.close()
    assert np.array_equal(ups, [(0.0, -1.0, 0.0), (0.0, 0.0, -1.0)]), "once by the camera, once by the objects"


def test_why_fusion_refuses_a_reset_is_told(server: viser.ViserServer) -> None:
    fleet, told, answers = Fleet(), list[str](), ["fusion is busy; ask again"]
    page = Page(server, fleet, DashboardSettings(points_max=1000), "tcp/a:1", always=False)
    page._shown = [SimpleNamespace(name="drone")]
    client = SimpleNamespace(add_notification=lambda _robot, text, **_: told.append(text))

    def answer(query: zenoh.Query) -> None:
        with query:
            if answers:
                query.reply_err(answers.pop().encode())
            else:
                query.reply(key("drone", "fusion/reset"), encode(SAMPLES["Progress"]))

    try:
        with open_router((free_loopback_endpoint(),)) as session:
            fleet._session = session
            queryable = session.declare_queryable(key("drone", "fusion/reset"), answer)
            page._reset(client)
            page._reset(client)
            queryable.undeclare()
            page._reset(client)
    finally:
        fleet._session = None
        page.close()
    assert told[:2] == ["fusion refuses: fusion is busy; ask again", "fusion restarts with an empty map"]
    assert told[2].startswith("fusion did not answer: check that it runs")
