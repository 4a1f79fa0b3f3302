"""Many browsers at once: what they are sent over their web sockets, without a browser."""

import asyncio
import dataclasses
import threading
from contextlib import AsyncExitStack

import pytest

pytest.importorskip("viser", reason="the dashboard's packages are not installed")

import msgspec
import numpy as np
import viser
import zstandard
from dashboard_robot import robot_at_work
from viser import _messages
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from spot3d.dashboard import page
from spot3d.dashboard.process import open_server, serve
from spot3d.dashboard.settings import DashboardSettings
from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.settings import LinkSettings

VIEWERS = 10
PICTURES = 4
"""So many of a page's pictures show that it goes on."""
LIMIT_S = 60
_AT_HOME = _messages.ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(0.0, 0.0, -3.0),
    fov=0.9,
    near=0.1,
    far=100.0,
    image_height=800,
    image_width=1200,
    look_at=(0.0, 0.0, 0.0),
    up_direction=(0.0, 0.0, 1.0),
)


def test_ten_viewers_see_it_go_on_while_one_is_stuck_and_all_views_are_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    flying, landed, stop = threading.Semaphore(0), threading.Event(), threading.Event()

    def fly_for_long(*_: object) -> None:
        flying.release()
        landed.wait(2 * LIMIT_S)

    monkeypatch.setattr(page, "fly", fly_for_long)
    endpoint = free_loopback_endpoint()
    settings, router = DashboardSettings(port=0), LinkSettings(mode="router", listen=(endpoint,), connect=())
    with open_server(settings) as server:
        thread = threading.Thread(target=serve, args=(server, router, settings, stop))
        thread.start()
        try:
            with robot_at_work(LinkSettings(robot="drone-1", connect=(endpoint,)), frames=10_000):
                asyncio.run(asyncio.wait_for(_all_see_pictures(server.get_port(), flying), LIMIT_S))
        finally:
            landed.set()
            stop.set()
            thread.join(20)
            assert not thread.is_alive()


async def _all_see_pictures(port: int, flying: threading.Semaphore) -> None:
    """Return when each of the viewers has seen the page's picture change while the views of all are being moved."""
    async with AsyncExitStack() as stack:
        viewers = [await stack.enter_async_context(_viewer(port)) for _ in range(VIEWERS + 1)]
        for viewer in viewers:
            await viewer.send(_encoded(_AT_HOME))
        viewers.pop().transport.pause_reading()
        all_fly = asyncio.create_task(asyncio.to_thread(_all_fly, flying))
        await asyncio.gather(all_fly, *(_sees_pictures(viewer, all_fly) for viewer in viewers))


def _viewer(port: int) -> connect:
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    return connect(
        f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None, compression=None, close_timeout=0.1
    )


def _encoded(message: _messages.Message) -> bytes:
    return msgspec.msgpack.encode(dataclasses.asdict(message) | {"type": type(message).__name__})


def _all_fly(flying: threading.Semaphore) -> None:
    for _ in range(VIEWERS + 1):
        assert flying.acquire(timeout=LIMIT_S)


async def _sees_pictures(viewer: ClientConnection, all_fly: "asyncio.Task[None]") -> None:
    left = PICTURES
    async for sent in viewer:
        assert isinstance(sent, bytes)
        if all_fly.done() and _shows_picture(sent):
            left -= 1
            if left == 0:
                return


def _shows_picture(sent: bytes) -> bool:
    """Whether a message of viser's web socket gives the page another picture: lengths, packed messages, arrays."""
    size, packed = np.frombuffer(sent, "<u8", 2).tolist()
    messages = msgspec.msgpack.decode(zstandard.decompress(sent[16 : 16 + packed], max_output_size=size))["messages"]
    return any("_data" in message.get("updates", ()) for message in messages)
