"""What a run keeps of a camera's frames, which come only once: a few, from all along the way, for its picture."""

import time
from collections.abc import Iterator
from contextlib import ExitStack

import zenoh

from spot3d.camera import Intrinsics
from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.payload import intact_bytes
from spot3d.frame import RgbdFrame
from spot3d.source.errors import SourceError
from spot3d_schemas import CodecError, Heat, decode, key

FRAMES_MOST = 20
"""Frames that are kept: 30 MB of VGA."""
_FIRST_INTERVAL_NS = 250_000_000
_LOOK_S = 0.1
"""Messages that come sooner after the last one are not looked at."""


class CameraFrames:
    """A FrameSequence of at most 20 frames, evenly spread in time however long the camera is watched."""

    has_true_poses = False
    rate_hz = 0.0

    def __init__(self, name: str) -> None:
        self._name = name
        self._stream = ""
        self._frames: list[RgbdFrame] = []
        self._interval_ns = _FIRST_INTERVAL_NS
        self._look_s = 0.0

    def follow(self, stream: str) -> None:
        """Keep frames of this stream; what is kept of another is forgotten."""
        if stream != self._stream:
            self._stream, self._frames, self._interval_ns = stream, [], _FIRST_INTERVAL_NS

    def hear(self, session: zenoh.Session, robot: str) -> ExitStack:
        """Keep frames of what the heatmap stage sends, where all are that are fused, until the stack is closed."""

        def take(sample: zenoh.Sample) -> None:
            now_s = time.monotonic()
            if now_s < self._look_s:
                return
            self._look_s = now_s + _LOOK_S
            payload = intact_bytes(sample.payload)
            try:
                heat = None if payload is None else decode(payload, Heat)
            except CodecError:
                return
            if heat is not None and heat.header.stream in (None, self._stream):
                self.add(rgbd_frame(heat))

        stack = ExitStack()
        stack.callback(session.declare_subscriber(key(robot, "heatmap/heat"), take).undeclare)
        return stack

    def add(self, frame: RgbdFrame) -> None:
        """Keep the frame if it is late enough after the last; where there are too many, every other one goes."""
        if self._frames and frame.stamp_ns - self._frames[-1].stamp_ns < self._interval_ns:
            return
        if len(self._frames) == FRAMES_MOST:
            del self._frames[1::2]
            self._interval_ns *= 2
        self._frames.append(frame)

    @property
    def image(self) -> tuple[int, int]:
        """Width and height in pixels; (0, 0) before the first frame."""
        camera = self._frames[0].intrinsics if self._frames else None
        return (0, 0) if camera is None else (camera.width, camera.height)

    @property
    def intrinsics(self) -> Intrinsics:
        """Those of the first frame. Raises SourceError before it is there."""
        if not self._frames:
            raise SourceError(f"the intrinsics of {self._name} come with its frames")
        return self._frames[0].intrinsics

    @property
    def stamps_ns(self) -> list[int]:
        """Capture times in integer nanoseconds, ascending."""
        return [frame.stamp_ns for frame in self._frames]

    def true_pose(self, index: int) -> None:
        """None."""

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> RgbdFrame:
        return self._frames[index]

    def __iter__(self) -> Iterator[RgbdFrame]:
        return iter(self._frames)
