"""When each frame is due."""

from spot3d.dataflow.node import Node
from spot3d.dataflow.pace import Pace


class FramePace:
    """Keeps the recorded pace, a given rate, or none."""

    def __init__(self, node: Node, rate_hz: float | None, recorded: bool) -> None:
        self._node, self._rate_hz, self._recorded = node, rate_hz, recorded
        # At a given rate, each frame counts as a recorded second.
        self._pace = Pace(rate_hz or 1.0, node.note)
        self._first_ns = 0

    def wait(self, sent: int, stamp_ns: int) -> None:
        """Sleep until the frame is due."""
        if sent == 0:
            self._pace.restart()
            self._first_ns = stamp_ns
        if self._rate_hz is not None or self._recorded:
            recorded_s = 1e-9 * (stamp_ns - self._first_ns) if self._rate_hz is None else float(sent)
            self._pace.wait(recorded_s, self._node.stop, self._node.rest)
