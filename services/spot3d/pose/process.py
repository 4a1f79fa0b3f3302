"""The pose stage's process: one pose for each frame."""

import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.session import StoppedError
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.warm_up import warm_up
from spot3d.frame import RgbdFrame
from spot3d.pose.estimate import PoseEstimate, PoseTracker
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d_schemas import Frame, Pose

_IN, _OUT = "source/frame", "pose/pose"
_FORGOTTEN = "surfels and landmarks forgotten: the map's limit is reached"
_RESTARTED = "given poses jumped: the map that corrects them began anew"
_HOMELESS = "started amid a run, whose world it cannot know: frames that carry a pose, or a new run, give it one"


def run(
    link: LinkSettings,
    settings: PoseSettings,
    stop: threading.Event | None = None,
    anchor: NDArray[np.float64] | Literal["frame"] | None = None,
) -> None:
    """Publish the pose of every frame that comes, until stopped by `stop`, SIGINT or SIGTERM.

    anchor: where the world is, for a stage that is started again amid a run: T_world_camera (4, 4) of the frame that
    comes first, or "frame": only frames that carry a pose can tell, and others are lost until one has. None: the
    first frame's pose, or identity.

    A frame that the provider fails on counts as an error and has a "lost" pose, so that nobody waits for it.
    Raises ModuleNotFoundError where the provider's package is absent.
    """
    tracker = make_tracker(settings)
    warm_up("pose", partial(_track_all, make_tracker(settings)))
    with stop_on_signals(stop) as stopped:
        try:
            with Node("pose", link, stopped, (_IN,), (_OUT,)) as node:
                _serve(node, tracker, settings.provider, anchor)
        except StoppedError:
            return


def _track_all(tracker: PoseTracker, frames: Sequence[RgbdFrame]) -> None:
    for frame in frames:
        tracker.track(frame.stamp_ns, frame.depth_metres(), frame.intrinsics, frame.T_world_camera, frame.colour)


def _serve(
    node: Node, tracker: PoseTracker, provider: str, anchor: NDArray[np.float64] | Literal["frame"] | None
) -> None:
    last = PoseEstimate(np.eye(4), "lost")
    while not node.stop.is_set():
        item = node.next()
        if item is None:
            continue
        given: Received[Frame] = item[1]
        frame = rgbd_frame(given.message)
        if isinstance(anchor, np.ndarray):
            frame = replace(frame, T_world_camera=anchor)
        if isinstance(anchor, str) and frame.T_world_camera is None:
            last = PoseEstimate(last.T_world_camera, "lost", _HOMELESS)
        else:
            last = _track(node, tracker, frame, last)
        if last.status == "ok":
            anchor = None
        pose = Pose(
            header=node.header(_OUT, given),
            T_world_camera=last.T_world_camera,
            status=last.status,
            reason=last.reason,
            provider=provider,
        )
        if node.publish(_OUT, pose):
            node.measure_latency(pose.header)


def _track(node: Node, tracker: PoseTracker, frame: RgbdFrame, last: PoseEstimate) -> PoseEstimate:
    start_s = time.perf_counter()
    try:
        estimate = tracker.track(
            frame.stamp_ns, frame.depth_metres(), frame.intrinsics, frame.T_world_camera, frame.colour
        )
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        node.failed(f"pose {type(error).__name__}", f"no pose of the frame at {frame.stamp_ns} ns: {text}")
        return PoseEstimate(last.T_world_camera, "lost", text)
    node.counters.step(time.perf_counter() - start_s)
    if estimate.forgotten:
        node.counters.event(_FORGOTTEN, estimate.forgotten)
    if estimate.restarted:
        node.counters.event(_RESTARTED)
    return estimate
