"""Updates beside the fusing: who waits for one hears that it is on its way."""

import threading
from contextlib import closing

import numpy as np

from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.settings import LinkSettings
from spot3d.found_object import FoundObjects
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.snapshot import Account, Kept, keep
from spot3d.fusion.snapshot_keeper import SnapshotKeeper
from spot3d.fusion.updates import Update, Updates
from spot3d_schemas import Header, Message, Progress

LIMIT_S = 20.0


def test_who_waits_for_an_update_is_called_again_and_again() -> None:
    stop, end, calls, runs = threading.Event(), threading.Event(), list[int](), list[int]()
    node = Node("fusion", LinkSettings(), stop)
    header = Header(robot="robot", seq=0, stamp_ns=0, frame_id="camera")
    progress = Progress(header=header, fused=0, skipped={}, last_stamp_ns=0, complete=False)

    def count() -> None:
        calls.append(1)
        if len(calls) == 3:
            end.set()

    def fail_at_last() -> FoundObjects:
        assert end.wait(LIMIT_S)
        runs.append(1)
        raise RuntimeError("enough")

    with closing(Updates(node, SnapshotKeeper(node))) as updates:
        assert updates.wait(count, 0.01)
        assert not calls, "nothing to wait for"
        turned_s = node._turned_s
        updates.submit(Update(fail_at_last, 0, Received(progress, 0), 0, False, False, "a"))
        assert updates.wait(count, 0.01)
        assert node._turned_s > turned_s, "a stage that waits for an update does not hang"
        for _ in range(2):  # an update that fails does not keep the next one from being computed
            updates.submit(Update(fail_at_last, 0, Received(progress, 0), 0, False, False, "a"))
            assert updates.wait(count, 10.0)
    assert len(runs) == 3
    assert len(calls) >= 3


class SlowNode(Node):
    """A link that takes its time with what is sent."""

    begun, go = threading.Event(), threading.Event()

    def publish(self, topic: str, message: Message) -> bool:
        """Send nothing, once told to go on."""
        self.begun.set()
        return self.go.wait(LIMIT_S)


def nothing_found() -> FoundObjects:
    return FoundObjects([], np.array([0.0, 0.0, 1.0]), 1)


class SilentNode(Node):
    """A link that sends nothing."""

    def publish(self, topic: str, message: Message) -> bool:
        """Say that it is sent."""
        return True


class FullKeeper(SnapshotKeeper):
    """Has no memory left."""

    asked = 0

    def write(self, kept: Kept) -> None:
        """Save nothing."""
        self.asked += 1
        raise MemoryError


def test_an_update_that_cannot_be_saved_keeps_no_later_one_from_being_computed() -> None:
    stop, fusion = threading.Event(), Fusion(FusionSettings())
    node = SilentNode("fusion", LinkSettings(), stop, outputs=("fusion/objects",))
    header = Header(robot="robot", seq=0, stamp_ns=0, frame_id="camera")
    progress = Progress(header=header, fused=0, skipped={}, last_stamp_ns=0, complete=False)
    kept = keep(fusion, Account("a stream", "an epoch", "a world", 5, 6, {}, 6, 7))
    keeper, limit = FullKeeper(node), threading.Timer(LIMIT_S, stop.set)
    limit.start()
    with closing(Updates(node, keeper)) as updates:
        for _ in range(2):
            updates.submit(Update(nothing_found, 1, Received(progress, 0), 0, False, False, "a", kept))
            assert updates.wait(lambda: None)
    limit.cancel()
    assert keeper.asked == 2


def test_objects_of_before_a_reset_are_sent_before_its_answer_or_not_at_all() -> None:
    node = SlowNode("fusion", LinkSettings(), threading.Event(), outputs=("fusion/objects",))
    header = Header(robot="robot", seq=0, stamp_ns=0, frame_id="camera")
    progress = Progress(header=header, fused=0, skipped={}, last_stamp_ns=0, complete=False)
    with closing(Updates(node, SnapshotKeeper(node))) as updates:
        updates.submit(Update(nothing_found, 1, Received(progress, 0), 0, False, False, "a"))
        assert node.begun.wait(LIMIT_S)
        reset = threading.Thread(target=updates.forget, daemon=True)
        reset.start()
        reset.join(0.3)
        assert reset.is_alive(), "what is on its way is waited for"
        node.go.set()
        reset.join(LIMIT_S)
        assert not reset.is_alive()
