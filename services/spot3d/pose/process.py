"""The pose stage's process: one pose for each frame."""

import threading
import time

import numpy as np

from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.session import StoppedError
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.pose.estimate import PoseEstimate, PoseTracker
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d_schemas import Frame, Pose

_IN, _OUT = "source/frame", "pose/pose"


def run(link: LinkSettings, settings: PoseSettings, stop: threading.Event | None = None) -> None:
    """Publish the pose of every frame that comes, until stopped by `stop`, SIGINT or SIGTERM.

    A frame that the provider fails on counts as an error and has a "lost" pose, so that nobody waits for it.
    Raises ModuleNotFoundError where the provider's package is absent.
    """
    tracker = make_tracker(settings)
    with stop_on_signals(stop) as stopped:
        try:
            with Node("pose", link, stopped, (_IN,), (_OUT,)) as node:
                _serve(node, tracker, settings.provider)
        except StoppedError:
            return


def _serve(node: Node, tracker: PoseTracker, provider: str) -> None:
    last = PoseEstimate(np.eye(4), "lost")
    while not node.stop.is_set():
        item = node.next()
        if item is None:
            continue
        given: Received[Frame] = item[1]
        last = _track(node, tracker, given.message, last)
        pose = Pose(
            header=node.header(_OUT, given),
            T_world_camera=last.T_world_camera,
            status=last.status,
            reason=last.reason,
            provider=provider,
        )
        if node.publish(_OUT, pose):
            node.measure_latency(pose.header)


def _track(node: Node, tracker: PoseTracker, message: Frame, last: PoseEstimate) -> PoseEstimate:
    frame = rgbd_frame(message)
    start_s = time.perf_counter()
    try:
        estimate = tracker.track(frame.stamp_ns, frame.depth_metres(), frame.intrinsics, frame.T_world_camera)
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        node.failed(f"pose {type(error).__name__}", f"no pose of the frame at {frame.stamp_ns} ns: {text}")
        return PoseEstimate(last.T_world_camera, "lost", text)
    node.counters.step(time.perf_counter() - start_s)
    return estimate
