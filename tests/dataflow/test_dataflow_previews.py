"""Small pictures of frames go out only while somebody subscribes, and not too many."""

import threading
import time

import numpy as np
import pytest
from zenoh.handlers import FifoChannel

from spot3d.camera import Intrinsics
from spot3d.dataflow.node import Node
from spot3d.dataflow.previews import Previews, preview
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Header, Preview, decode, key
from waiting import wait_until

CAMERA = Intrinsics(500.0, 510.0, 319.5, 239.5, 640, 480)


@pytest.mark.parametrize(
    ("size", "expected"), [((640, 480), (320, 240)), ((200, 100), (200, 100)), ((480, 1920), (160, 640))]
)
def test_a_preview_is_small_and_its_camera_fits(size: tuple[int, int], expected: tuple[int, int]) -> None:
    camera = Intrinsics(500.0, 500.0, (size[0] - 1) / 2, (size[1] - 1) / 2, *size)
    image, small = preview(np.zeros(camera.shape, np.uint8), camera)
    assert (small.width, small.height) == expected
    assert image.shape == (expected[1], expected[0], 3)
    assert (small.cx, small.cy) == ((expected[0] - 1) / 2, (expected[1] - 1) / 2), "the middle stays the middle"
    assert small.fx / small.width == pytest.approx(camera.fx / camera.width)


def test_previews_go_out_only_while_somebody_looks() -> None:
    endpoint, stop = free_loopback_endpoint(), threading.Event()
    link = LinkSettings(robot="shy", connect=(endpoint,))
    image, header = np.full((480, 640, 3), 200, np.uint8), Header(robot="shy", seq=0, stamp_ns=7, frame_id="camera")
    with open_router((endpoint,)) as session, Node("source", link, stop, (), ("source/preview",)) as node:
        previews = Previews(node, "source/preview")
        previews.offer(header, image, CAMERA)
        assert not node.wanted("source/preview")
        subscriber = session.declare_subscriber(key("shy", "source/preview"), FifoChannel(64))
        wait_until(lambda: node.wanted("source/preview"))
        begin_s = time.monotonic()
        for _ in range(100):
            previews.offer(header, image, CAMERA)
            time.sleep(0.005)
        most = 2 + (time.monotonic() - begin_s) / 0.2
        payloads = [subscriber.recv().payload.to_bytes()]
        while (sample := subscriber.handler.try_recv()) is not None:
            payloads.append(sample.payload.to_bytes())
        assert 2 <= len(payloads) <= most
        assert max(map(len, payloads)) < 20_000
        assert decode(payloads[0], Preview).header.stamp_ns == 7
        subscriber.undeclare()
        wait_until(lambda: not node.wanted("source/preview"))
