"""Updates beside the fusing: who waits for one hears that it is on its way."""

import threading
from contextlib import closing

import numpy as np
import pytest

from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.process_use import ProcessUse
from spot3d.dataflow.settings import LinkSettings
from spot3d.fusion.fusion import FoundObjects, Fusion
from spot3d.fusion.inputs import Ready
from spot3d.fusion.keeping import Keeping
from spot3d.fusion.map_answers import MapAnswers
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.stage import FAILED, LOST, Stage
from spot3d.fusion.updates import Update, Updates
from spot3d_schemas import CameraIntrinsics, Header, Heat, Message, Pose, Progress

LIMIT_S = 20.0


class LongTask:
    """An update that takes until it is told to end."""

    frame_count = 0
    end = threading.Event()
    runs = 0

    def run(self) -> FoundObjects:
        """Nothing, at last."""
        assert self.end.wait(LIMIT_S)
        LongTask.runs += 1
        raise RuntimeError("enough")


def test_who_waits_for_an_update_is_called_again_and_again() -> None:
    stop, calls = threading.Event(), list[int]()
    node = Node("fusion", LinkSettings(), stop)
    header = Header(robot="robot", seq=0, stamp_ns=0, frame_id="camera")
    progress = Progress(header=header, fused=0, skipped={}, last_stamp_ns=0, complete=False)

    def count() -> None:
        calls.append(1)
        if len(calls) == 3:
            LongTask.end.set()

    with closing(Updates(node, Keeping(node))) as updates:
        assert updates.wait(count, 0.01)
        assert not calls, "nothing to wait for"
        updates.submit(Update(LongTask(), Received(progress, 0), 0, False, False, "a"))
        assert updates.wait(count, 0.01)
        for _ in range(2):  # an update that fails does not keep the next one from being computed
            updates.submit(Update(LongTask(), Received(progress, 0), 0, False, False, "a"))
            assert updates.wait(count, 10.0)
    assert LongTask.runs == 3
    assert len(calls) >= 3


class SlowNode(Node):
    """A link that takes its time with what is sent."""

    begun, go = threading.Event(), threading.Event()

    def publish(self, topic: str, message: Message) -> bool:
        """Send nothing, once told to go on."""
        self.begun.set()
        return self.go.wait(LIMIT_S)


class NothingFound:
    """An update without objects."""

    frame_count = 1

    def run(self) -> FoundObjects:
        """No objects."""
        return FoundObjects([], np.array([0.0, 0.0, 1.0]), 1)


def test_objects_of_before_a_reset_are_sent_before_its_answer_or_not_at_all() -> None:
    node = SlowNode("fusion", LinkSettings(), threading.Event(), outputs=("fusion/objects",))
    header = Header(robot="robot", seq=0, stamp_ns=0, frame_id="camera")
    progress = Progress(header=header, fused=0, skipped={}, last_stamp_ns=0, complete=False)
    with closing(Updates(node, Keeping(node))) as updates:
        updates.submit(Update(NothingFound(), Received(progress, 0), 0, False, False, "a"))
        assert node.begun.wait(LIMIT_S)
        reset = threading.Thread(target=updates.forget, daemon=True)
        reset.start()
        reset.join(0.3)
        assert reset.is_alive(), "what is on its way is waited for"
        node.go.set()
        reset.join(LIMIT_S)
        assert not reset.is_alive()


@pytest.mark.parametrize(("status", "reason"), [("lost", LOST), ("ok", FAILED)])
def test_frames_that_are_not_fused_are_told_with_the_drops(status: str, reason: str) -> None:
    node = Node("fusion", LinkSettings(), threading.Event(), outputs=("fusion/objects",))
    fusion, keeping = Fusion(FusionSettings()), Keeping(node)
    fusion.heatmap.arrays = None  # type: ignore[assignment]  # so that fusing fails
    shape, camera = (60, 80), CameraIntrinsics(fx=70.0, fy=70.0, cx=39.5, cy=29.5, width=80, height=60)
    heat = Heat(
        header=Header(robot="robot", seq=0, stamp_ns=1, frame_id="camera"),
        intrinsics=camera,
        depth_scale=0.001,
        colour=np.zeros((*shape, 3), np.uint8),
        depth=np.full(shape, 1000, np.uint16),
        heat=np.zeros(shape, np.uint8),
        accepted=0,
        masked=0,
        rejected=0,
    )
    pose = Pose(header=heat.header, T_world_camera=np.eye(4), status=status, reason="", provider="given")
    with closing(Updates(node, keeping)) as updates, closing(MapAnswers(node)) as answers:
        Stage(node, fusion, keeping, updates, answers, None)._fuse(Ready(Received(heat, 0), Received(pose, 0), None))
    health = node.counters.health(heat.header, 1.0, ProcessUse(cpu_s=0.0, rss_bytes=1, threads=1))
    assert health.drops == {reason: 1}
