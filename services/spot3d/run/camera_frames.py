"""What a run keeps of a camera's frames, which come only once: a few, from all along the way, for its picture."""

import time
from contextlib import ExitStack

import zenoh

from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.payload import decoded
from spot3d.frame import RgbdFrame
from spot3d.source.sequence import FrameList
from spot3d_schemas import Heat, key

FRAMES_MOST = 20
"""Frames that are kept: 30 MB of VGA."""
_FIRST_INTERVAL_NS = 250_000_000
_LOOK_S = 0.1
"""Messages that come sooner after the last one are not looked at."""


class CameraFrames(FrameList):
    """At most 20 frames, evenly spread in time however long the camera is watched."""

    def __init__(self) -> None:
        super().__init__()
        self._stream = ""
        self._interval_ns = _FIRST_INTERVAL_NS
        self._look_s = 0.0

    def follow(self, stream: str) -> None:
        """Keep frames of this stream; what is kept of another is forgotten."""
        if stream != self._stream:
            self._stream, self.frames, self._interval_ns = stream, [], _FIRST_INTERVAL_NS

    def hear(self, session: zenoh.Session, robot: str) -> ExitStack:
        """Keep frames of what the heatmap stage sends, where all are that are fused, until the stack is closed."""

        def take(sample: zenoh.Sample) -> None:
            now_s = time.monotonic()
            if now_s < self._look_s:
                return
            self._look_s = now_s + _LOOK_S
            heat = decoded(sample.payload, Heat)
            if heat is not None and heat.header.stream in (None, self._stream):
                self.add(rgbd_frame(heat))

        stack = ExitStack()
        stack.callback(session.declare_subscriber(key(robot, "heatmap/heat"), take).undeclare)
        return stack

    def add(self, frame: RgbdFrame) -> None:
        """Keep the frame if it is late enough after the last; where there are too many, every other one goes."""
        if self.frames and frame.stamp_ns - self.frames[-1].stamp_ns < self._interval_ns:
            return
        if len(self.frames) == FRAMES_MOST:
            del self.frames[1::2]
            self._interval_ns *= 2
        self.frames.append(frame)

    @property
    def image(self) -> tuple[int, int]:
        """Width and height in pixels; (0, 0) before the first frame."""
        return (self.intrinsics.width, self.intrinsics.height) if self.frames else (0, 0)
