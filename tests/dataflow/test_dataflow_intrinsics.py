"""A camera program whose intrinsics hardly fit its images is told so, by whichever stage runs."""

import logging
import threading
import time
from itertools import count

import numpy as np
import pytest
import zenoh

from spot3d.dataflow.node import Node
from spot3d.dataflow.process_use import process_use
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import CameraIntrinsics, Frame, Header, encode, encoding, key
from waiting import wait_until

TOPIC, ROBOT = "source/frame", "off-centre"
COLOUR, DEPTH = np.zeros((48, 64, 3), np.uint8), np.ones((48, 64), np.uint16)
SAID = "the principal point (63.5, 47.5) is far from the centre of the 64x48 image"


def test_intrinsics_of_another_image_size_are_told_once_without_a_pose_stage(caplog: pytest.LogCaptureFixture) -> None:
    endpoint, numbers = free_loopback_endpoint(), count()
    link = LinkSettings(robot=ROBOT, connect=(endpoint,), shared_memory=False)
    caplog.set_level(logging.INFO)
    with (
        open_router((endpoint,)),
        Node("heatmap", link, threading.Event(), (TOPIC,)) as node,
        open_session(link) as program,
    ):
        block = zenoh.CongestionControl.BLOCK
        publisher = program.declare_publisher(key(ROBOT, TOPIC), encoding=encoding(Frame), congestion_control=block)
        wait_until(lambda: publisher.matching_status.matching)

        def told_after(cx: float, cy: float) -> int:
            seq = next(numbers)
            header = Header(robot=ROBOT, seq=seq, stamp_ns=seq * 10**8, frame_id="camera")
            camera = CameraIntrinsics(fx=60.0, fy=60.0, cx=cx, cy=cy, width=64, height=48)
            images = {"colour": COLOUR, "depth": DEPTH, "depth_scale": 0.001, "intrinsics": camera}
            publisher.put(encode(Frame(header=header, **images, T_world_camera=None)))
            wait_until(lambda: node.next() is not None)
            return node.counters.health(header, time.monotonic(), process_use()).events.get("intrinsics off centre", 0)

        assert [told_after(31.5, 23.5), told_after(63.5, 47.5), told_after(63.5, 47.5)] == [0, 1, 1]
    assert caplog.text.count(SAID) == 1
