"""When each frame is due."""

import time

from spot3d.dataflow.node import Node

_BEHIND_S = 0.5
"""A source that is later than this goes on from now and does not catch up in a burst."""


class Pace:
    """Keeps the recorded pace, a given rate, or none."""

    def __init__(self, node: Node, rate_hz: float | None, recorded: bool) -> None:
        self._node, self._rate_hz, self._recorded = node, rate_hz, recorded
        self._start_s = 0.0
        self._first_ns = 0

    def wait(self, sent: int, stamp_ns: int) -> None:
        """Sleep until the frame is due."""
        if sent == 0:
            self._start_s, self._first_ns = time.monotonic(), stamp_ns
        if self._rate_hz is not None:
            after_s = sent / self._rate_hz
        elif self._recorded:
            after_s = 1e-9 * (stamp_ns - self._first_ns)
        else:
            return
        late_s = time.monotonic() - self._start_s - after_s
        if late_s > _BEHIND_S:
            self._start_s += late_s
            self._node.note(
                "behind",
                f"the source is {late_s:.1f} s behind its schedule, and continues from here without catching up",
            )
        elif late_s < 0:
            self._node.rest(-late_s)
