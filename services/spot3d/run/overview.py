"""overview.png: the picture of the objects found, and the frames of a stream that it may show."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import zenoh
from numpy.typing import NDArray

from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.payload import decoded
from spot3d.drawing.overview import draw_overview
from spot3d.drawing.picture import write_picture
from spot3d.frame import RgbdFrame
from spot3d.run.one_sample import OneSample
from spot3d.run.results import RunResult
from spot3d_schemas import Frame, key

MOST = 24
"""Maximum number of frames: 40 MB at VGA."""
_FIRST_S = 0.5
"""Time between two frames at first, seconds; it doubles each time that there are too many."""
_POSES = 300
"""A frame's pose is looked up among so many latest ones."""

View = tuple[RgbdFrame, NDArray[np.float64]]
"""A frame with its T_world_camera."""


class OverviewFrames:
    """Takes a frame now and then, and unsubscribes in between: nobody sends frames that it would not keep.

    views: the frames so far, in their order. first: the first frame seen, whether its pose is known or not.
    """

    def __init__(self, robot: str) -> None:
        self._where = key(robot, "source/frame")
        self._listening: OneSample | None = None
        self.forget()

    def forget(self) -> None:
        """Start over, for another stream."""
        self.close()
        self.first: RgbdFrame | None = None
        self._interval_s, self._due_s = _FIRST_S, float("-inf")
        self._waiting: RgbdFrame | None = None
        self._poses: dict[int, NDArray[np.float64] | None] = {}
        self.views: list[View] = []

    def close(self) -> None:
        """Unsubscribe."""
        if self._listening is not None:
            self._listening.close()
            self._listening = None

    @property
    def image(self) -> tuple[int, int]:
        """Width and height in pixels; (0, 0) before the first frame."""
        return (0, 0) if self.first is None else self.first.depth.shape[1::-1]

    def pose(self, stamp_ns: int, T_world_camera: NDArray[np.float64] | None) -> None:
        """Record the pose of a frame; None: it is lost."""
        self._poses[stamp_ns] = T_world_camera
        while len(self._poses) > _POSES:
            del self._poses[next(iter(self._poses))]

    def look(self, session: zenoh.Session, stream: str | None, now_s: float) -> None:
        """Take a frame of this stream if one is due and there; call it often. Monotonic seconds."""
        if self._waiting is None and self._listening is None and now_s >= self._due_s:
            self._listening = OneSample(session, self._where)
        if self._listening is not None:
            sample = self._listening.sample
            if sample is None:
                return
            self.close()
            self._due_s = now_s + self._interval_s
            frame = decoded(sample.payload, Frame)
            if frame is not None and frame.header.stream == stream:
                self._waiting = rgbd_frame(frame)
                self.first = self.first or self._waiting
        if self._waiting is not None:
            stamp_ns = self._waiting.stamp_ns
            if stamp_ns in self._poses or now_s >= self._due_s:
                T_world_camera = self._poses.get(stamp_ns)
                if T_world_camera is not None:
                    self._keep(self._waiting, T_world_camera)
                self._waiting = None

    def _keep(self, frame: RgbdFrame, T_world_camera: NDArray[np.float64]) -> None:
        self.views.append((frame, T_world_camera))
        if len(self.views) > MOST:
            self.views = self.views[::2]
            self._due_s += self._interval_s
            self._interval_s *= 2


def write_overview(
    path: Path, name: str, views: Sequence[View], result: RunResult, camera_path: NDArray[np.float64]
) -> str:
    """Draw the objects into views of the recording `name`, in its order, and from above. camera_path: (m, 3), world.

    Returns why it cannot be drawn, for people; otherwise empty. Raises OSError where the file cannot be written.
    """
    count = len(result.objects)
    title = f"spot3d    {name}    {count} object{'s' * (count != 1)} in {result.frame_count} frames"
    points, up = result.points, np.array(result.up)
    try:
        picture = draw_overview(title, views, result.objects, points.xyz, points.rgb, camera_path, up)
    except Exception as error:  # messages may hold any finite numbers, and the other results must not be lost
        return f"{path.name} cannot be drawn: {type(error).__name__}: {error}"
    write_picture(path, picture)
    return ""
