"""The segments stage's process: joins heat with poses, and publishes the segments of each keyframe."""

import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from spot3d.dataflow.conversion import calibration_of, rgbd_frame, segments_message
from spot3d.dataflow.join import Outcome, Skipped, heat_pose_join
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.process_use import let_frames_go_first
from spot3d.dataflow.serving import On, serve
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.warm_up import warm_up
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.upper_side import event_of, notice
from spot3d_schemas import Heat, Message, Pose

if TYPE_CHECKING:
    from spot3d.segments.keyframe_segments import KeyframeSegments

_HEAT, _POSE, _OUT = "heatmap/heat", "pose/pose", "segments/segments"


def run(link: LinkSettings, settings: SegmentsSettings, stop: threading.Event | None = None) -> None:
    """Publish a message for every frame whose heat and pose arrive, until stopped by `stop`, SIGINT or SIGTERM.

    For a frame that is no keyframe, has a lost pose or fails (an error), the message says keyframe False, so that no
    subscriber waits for it.
    """
    if link.delivery == "live":
        let_frames_go_first()
    warm_up("segments", partial(_find_first, settings))
    with stop_on_signals(stop) as stopped, Node("segments", link, stopped, (_HEAT, _POSE), (_OUT,)) as node:
        stage = _Stage(node, settings)
        serve(node, On(_HEAT, Heat, stage.take_heat), On(_POSE, Pose, stage.take_pose))


def _find_first(settings: SegmentsSettings, frames: Sequence[RgbdFrame]) -> None:
    keyframes = _keyframes(settings)
    if keyframes is not None:
        heat = np.where(np.abs(frames[0].depth_metres() - 0.8) < 0.01, 255, 0).astype(np.uint8)
        keyframes.wants(frames[0].stamp_ns, np.eye(4))
        keyframes.find(frames[0], heat, np.eye(4))


def _keyframes(settings: SegmentsSettings) -> "KeyframeSegments | None":
    if not settings.enabled:
        return None
    # Imported here, so that its kernels are compiled at low priority in a live run, and `warm_up` logs that.
    from spot3d.segments.keyframe_segments import KeyframeSegments

    return KeyframeSegments(settings)


class _Stage:
    def __init__(self, node: Node, settings: SegmentsSettings) -> None:
        self.node, self.settings, self.recording = node, settings, 0
        self.keyframes = _keyframes(settings)
        self.join = heat_pose_join(node.link)

    def take_heat(self, given: Received[Heat]) -> None:
        self._begin_if_new(given)
        if given.recording != self.recording:
            self.recording = given.recording
            self._begin()
        self._answer(self.join.add_left(given))

    def take_pose(self, given: Received[Pose]) -> None:
        self._begin_if_new(given)
        self._answer(self.join.add_right(given))

    def _begin_if_new(self, given: Received[Message]) -> None:
        if given.begins:
            _count(self.node, self.join.clear())
            self._begin()

    def _begin(self) -> None:
        """Forget everything about the previous recording."""
        self.keyframes, self.node.state = _keyframes(self.settings), ""

    def _answer(self, outcome: Outcome[Heat, Pose]) -> None:
        _count(self.node, outcome.skipped)
        if outcome.pair is None:
            return
        heat, pose = outcome.pair
        found = self._find(heat.message, pose.message) if pose.message.status == "ok" else None
        # The heat's trace is the longer one: it holds the source, the proposals and the heatmap.
        message = segments_message(self.node.header(_OUT, heat), found)
        if self.node.publish(_OUT, message):
            self.node.measure_latency(message.header)

    def _find(self, heat: Heat, pose: Pose) -> FrameSegments | None:
        keyframes, stamp_ns = self.keyframes, heat.header.stamp_ns
        if keyframes is None or not keyframes.wants(stamp_ns, pose.T_world_camera, pose.epoch):
            return None
        start_s = time.perf_counter()
        try:
            found = keyframes.find(rgbd_frame(heat), heat.heat, pose.T_world_camera, calibration_of(pose))
        except Exception as error:
            self.node.crashed("segments", f"no segments of the frame at {stamp_ns} ns", error)
            return None
        if found is not None:
            self.node.counters.step(time.perf_counter() - start_s)
        side = keyframes.side_up
        if side and not self.node.state:
            self.node.state = notice(side)
            self.node.note(event_of(side), self.node.state)
        return found


def _count(node: Node, skipped: list[Skipped]) -> None:
    for frame in skipped:
        node.counters.drop(frame.reason)
