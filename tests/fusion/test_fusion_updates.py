"""Updates beside the fusing: who waits for one hears that it is on its way."""

import threading
from contextlib import closing

from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.settings import LinkSettings
from spot3d.fusion.fusion import FoundObjects
from spot3d.fusion.keeping import Keeping
from spot3d.fusion.updates import Update, Updates
from spot3d_schemas import Header, Progress

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
