"""The page in a real browser: headless Chromium, driven by Playwright. Skipped where no browser is installed."""

import json
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
import zenoh

pytest.importorskip("viser", reason="the dashboard's packages are not installed")
pytest.importorskip("playwright", reason="Playwright's Python client is not installed")

import viser
from dashboard_robot import robot_at_work
from playwright.sync_api import Page as Tab
from playwright.sync_api import expect, sync_playwright

from commands import router_process
from spot3d.boxes import Box3D
from spot3d.dashboard.process import open_server, serve
from spot3d.dashboard.settings import DashboardSettings
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.drawing.box_views import corners
from spot3d.drawing.picture import object_colour
from spot3d_schemas import Header, MapChanges, Object3D, Objects, alive_key, decode, encode, encoding, key

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
LIMIT_MS = 120_000
FRAMES = 40
"""The scene ends while the page is looked at: what stands still can be compared."""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is installed (make test-browser)")


@contextmanager
def dashboard(link: LinkSettings) -> Iterator[viser.ViserServer]:
    settings, stop = DashboardSettings(port=0), threading.Event()
    with open_server(settings) as server:
        thread = threading.Thread(target=serve, args=(server, link, settings, stop))
        thread.start()
        try:
            yield server
        finally:
            stop.set()
            thread.join(20)
            assert not thread.is_alive()


@contextmanager
def browser_tab(address: str) -> Iterator[tuple[Tab, list[str]]]:
    """A tab at this address, and the errors that its console has told."""
    errors: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=FLAGS)
        tab = browser.new_page(viewport={"width": 1400, "height": 850})
        tab.set_default_timeout(LIMIT_MS)
        tab.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(address)
        yield tab, errors
        browser.close()


@contextmanager
def second_robot(session: zenoh.Session) -> Iterator[None]:
    """Whoever speaks the contract is a robot."""
    box = Object3D(
        id=5,
        confidence=0.9,
        views=9,
        centre=np.zeros(3),
        size=np.array([0.1, 0.2, 0.3]),
        rotation=np.eye(3),
        points=400,
        colour=(1, 2, 3),
    )
    objects = Objects(
        header=Header(robot="drone-2", seq=0, stamp_ns=1, frame_id="camera"),
        objects=(box,),
        up=np.array([0.0, 0, 1]),
        frame_count=9,
        map_points=0,
        map_limit_reached=False,
        complete=False,
    )
    with session.liveliness().declare_token(alive_key("drone-2", "source")):
        session.put(key("drone-2", "fusion/objects"), encode(objects), encoding=encoding(Objects))
        yield


def test_the_page_in_a_browser() -> None:
    endpoint = free_loopback_endpoint()
    link = LinkSettings(robot="drone-1", connect=(endpoint,), health_interval_s=0.5)
    with dashboard(link) as server, browser_tab(f"http://127.0.0.1:{server.get_port()}") as (tab, errors):
        said(tab, "Waiting for a router")
        with router_process(listen=endpoint) as router:
            said(tab, "Waiting for a robot")
            with robot_at_work(link, FRAMES), open_session(link) as session:
                said(tab, ", complete")
                boxes_are_where_they_project(tab, server)
                with second_robot(session):
                    robots_are_told_apart(tab)
                    reset_asks_first(tab, session)
                    assert errors == []
                    router.kill()
                    said(tab, "none answers at")
                    with router_process(listen=endpoint):
                        tab.get_by_text("none answers at").wait_for(state="hidden")
                        expect(tab.get_by_role("row").filter(has_text="fusion")).to_contain_text(
                            "has produced no output for", timeout=LIMIT_MS
                        )


def said(tab: Tab, text: str) -> None:
    expect(tab.get_by_text(text).first).to_be_visible(timeout=LIMIT_MS)


def boxes_are_where_they_project(tab: Tab, server: viser.ViserServer) -> None:
    """Along the projected edges of the boxes that it saves, the page has their colours, and not beside them."""
    for part in ("Labels", "Camera", "Planes"):
        tab.get_by_role("checkbox", name=part).uncheck()
    tab.get_by_role("button", name="Look at everything").click()
    tab.wait_for_timeout(3000)
    with tab.expect_download() as download:
        tab.get_by_role("button", name="objects.json").click()
    saved = json.loads(Path(download.value.path()).read_text())["objects"]
    assert len(saved) >= 5
    view = cv2.cvtColor(cv2.imdecode(np.frombuffer(tab.screenshot(), np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    (client,) = server.get_clients().values()
    canvas = tab.locator("canvas").first.bounding_box()
    world = server.scene.get_handle_by_name("/drone-1")
    R_view_world = viser.transforms.SO3(world.wxyz).as_matrix()
    there, beside = (edge_share(view, client.camera, canvas, R_view_world, saved, shift) for shift in (0, 40))
    # The map's points hide the edges behind them.
    assert there > 0.35
    assert there > 1.7 * beside


def edge_share(view, camera, canvas, R_view_world, saved, shift: int) -> float:
    """The share of the samples of all boxes' edges that have their box's colour within two pixels."""
    R_camera_view = viser.transforms.SO3(camera.wxyz).as_matrix().T
    focal = canvas["height"] / 2 / np.tan(camera.fov / 2)
    hits = []
    for item in saved:
        box = Box3D(*(np.array(item[name]) for name in ("centre", "size", "rotation")))
        points = (corners(box) @ R_view_world.T - camera.position) @ R_camera_view.T
        uv = points[:, :2] / points[:, 2:] * focal
        uv += (canvas["x"] + canvas["width"] / 2 + shift, canvas["y"] + canvas["height"] / 2)
        for a in range(8):
            for b in (a ^ 1, a ^ 2, a ^ 4):
                for share in np.linspace(0.1, 0.9, 9):
                    x, y = np.rint(uv[a] + share * (uv[b] - uv[a])).astype(int)
                    around = view[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4].astype(int)
                    hits.append(bool((np.abs(around - object_colour(item["id"])).max(axis=2) < 45).any()))
    return float(np.mean(hits))


def robots_are_told_apart(tab: Tab) -> None:
    for choice, told in (
        ("drone-2", ["drone-2: 1 object in 9"]),
        ("all, in one world", ["drone-1: ", "drone-2: "]),
        ("drone-1", ["drone-1: "]),
    ):
        tab.get_by_role("combobox", name="Robot").click()
        tab.get_by_role("option", name=choice).click()
        for text in told:
            said(tab, text)


def reset_asks_first(tab: Tab, session: zenoh.Session) -> None:
    tab.get_by_text("Reset the map ...").click()
    tab.get_by_role("button", name="Cancel").click()
    before = generation(session)
    tab.get_by_text("Reset the map ...").click()
    tab.get_by_role("button", name="Reset", exact=True).click()
    said(tab, "fusion restarts with an empty map")
    assert generation(session) != before


def generation(session: zenoh.Session) -> int:
    (reply,) = session.get(key("drone-1", "fusion/changes"), timeout=20)
    return decode(reply.ok.payload.to_bytes(), MapChanges).generation
