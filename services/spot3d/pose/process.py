"""The pose stage's process: one pose for each frame."""

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, off_centre
from spot3d.dataflow.conversion import corrections_message, rgbd_frame
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.serving import On, serve
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.snapshot_file import SnapshotError, snapshot_bytes
from spot3d.dataflow.snapshot_writer import SnapshotWriter, snapshot_path
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.streams import new_stream
from spot3d.dataflow.warm_up import warm_up
from spot3d.frame import RgbdFrame
from spot3d.pose import delay, depth_scale, orientation
from spot3d.pose.estimate import GIVEN_JUMPED, GIVEN_OTHERWISE, GIVEN_TOO_FAR, PoseEstimate, PoseTracker
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.pose.snapshot import read_tracker, tracker_snapshot
from spot3d.pose.tracking import MapTracker
from spot3d_schemas import Frame, Pose

log = logging.getLogger(__name__)

_IN, _OUT = "source/frame", "pose/pose"
_FORGOTTEN = "surfels and landmarks forgotten: the map's limit is reached"
_SNAPSHOT_S = 2.0
"""Time between two snapshots of the tracker's map, if any are kept: what is newer helps little to relocalise."""
_SPREAD = 20
"""Factor of the time between warm-up frames, which is at first that of a camera."""
_TOLD_NS = 1_000_000_000
"""Tracking that is lost for this long is reported."""
_JUMPS_NS = 10_000_000_000
"""Given poses that jump twice within this time are reported in the state: a tracker begins anew once."""


def run(link: LinkSettings, settings: PoseSettings, stop: threading.Event | None = None) -> None:
    """Publish the pose of every received frame, until stopped by `stop`, SIGINT or SIGTERM.

    Each stream of frames has a world of its own, whose name, the epoch, the poses carry. A stage restarted during a
    stream is lost until it relocalises in its last world, from its snapshot; without a snapshot it begins another
    world. Given poses need no snapshot. A frame on which the provider raises counts as an error and gets a "lost" pose,
    so that no stage waits for it.
    Raises ModuleNotFoundError where the provider's package is absent.
    """
    warm_up("pose", partial(track_all, make_tracker(settings)))
    with stop_on_signals(stop) as stopped, Node("pose", link, stopped, (_IN,), (_OUT,)) as node:
        _Stage(node, settings).serve()


def track_all(tracker: PoseTracker, frames: Sequence[RgbdFrame]) -> None:
    """Run a tracker on the frames of a warm-up, so that every kernel is called."""
    # Some are to be keyframes, which are far apart; odometry must follow the others from one to the next.
    close = len(frames) - 2 if isinstance(tracker, MapTracker) else 0
    for number, frame in enumerate(frames):
        stamp_ns = frame.stamp_ns * (1 if number < close else _SPREAD)
        tracker.track(replace(frame, stamp_ns=stamp_ns))
    # Kernels of a full map and of a snapshot, which few frames do not call.
    if isinstance(tracker, MapTracker) and (state := tracker.state()) is not None:
        tracker.resume(state)


class _Stage:
    def __init__(self, node: Node, settings: PoseSettings) -> None:
        self.node, self.settings, self.recording = node, settings, 0
        interval_s = min(_SNAPSHOT_S, node.link.snapshot_interval_s)
        failed = partial(node.note, "no snapshot")
        self.snapshots = SnapshotWriter(snapshot_path(node.link, "pose"), interval_s, failed)
        self._begin()

    def serve(self) -> None:
        """Answer every frame."""
        serve(self.node, On(_IN, Frame, self._answer))
        self.snapshots.close()

    def _begin(self) -> None:
        """Start a new tracker and a new world for a new scene; the world of given poses is the stream's."""
        self.tracker = make_tracker(self.settings)
        self.epoch = new_stream() if isinstance(self.tracker, MapTracker) else self.node.stream
        self.last = PoseEstimate(np.eye(4), "lost")
        self.lost_since: tuple[int, str] | None = None
        self.followed = False
        self.jumps_ns = deque[int](maxlen=2)
        self.told: dict[str, NDArray[np.float64]] = {}
        self.node.state = ""

    def _answer(self, given: Received[Frame]) -> None:
        if given.begins or given.recording != self.recording:
            self.recording = given.recording
            self._begin()
            self._resume(given.message.header.stamp_ns)
        frame = rgbd_frame(given.message)
        self.last = self._track(frame)
        if self.last.restarted:
            self.jumps_ns.append(frame.stamp_ns)
            self.node.note(GIVEN_JUMPED, f"{GIVEN_JUMPED}; {GIVEN_OTHERWISE}")
        self._tell_if_lost(frame.stamp_ns, frame.intrinsics)
        self._tell_errors()
        pose = Pose(
            header=self.node.header(_OUT, given),
            T_world_camera=self.last.T_world_camera,
            status=self.last.status,
            reason=self.last.reason,
            provider=self.settings.provider,
            epoch=self.epoch,
            lost_since_ns=None if self.lost_since is None else self.lost_since[0],
            T_world_map=self.last.T_world_map,
            depth_factor=self.last.calibration.depth_factor,
            delay_s=self.last.delay_s,
            turn=np.array(self.last.calibration.turn),
            centre=np.array(self.last.calibration.centre),
            bend=np.array(self.last.calibration.bend) if self.last.calibration.bend else None,
            **corrections_message(self.last.corrections),
        )
        if self.node.publish(_OUT, pose):
            self.node.measure_latency(pose.header)
        if self.last.status == "ok" and self.snapshots.due(time.monotonic()):
            self._keep()

    def _resume(self, stamp_ns: int) -> None:
        """Go on in the world in which this stream was tracked before, if a snapshot from before this stamp has it."""
        stream, path = self.node.stream, self.snapshots.path
        if stream is None or self.node.link.snapshot_interval_s == 0 or not isinstance(self.tracker, MapTracker):
            return
        try:
            kept = read_tracker(path, stream)
        except (SnapshotError, OSError) as error:
            log.warning("tracking begins a new world: %s", error)
            return
        if kept is not None and kept[0].stamp_ns >= stamp_ns:
            log.warning("tracking begins a new world: timestamps are older than the snapshot %s", path)
        elif kept is not None:
            state, self.epoch = kept
            self.tracker.resume(state)
            self.followed = True
            log.info("relocalising in the world of %s, of %d surfels", path, len(state.keys))

    def _track(self, frame: RgbdFrame) -> PoseEstimate:
        start_s = time.perf_counter()
        try:
            estimate = self.tracker.track(frame)
        except Exception as error:
            self.node.crashed("pose", f"no pose of the frame at {frame.stamp_ns} ns", error)
            return PoseEstimate(self.last.T_world_camera, "lost", f"{type(error).__name__}: {error}")
        self.node.counters.step(time.perf_counter() - start_s)
        if estimate.forgotten:
            self.node.counters.event(_FORGOTTEN, estimate.forgotten)
        if estimate.remark:
            self.node.note(GIVEN_TOO_FAR, estimate.remark)
        return estimate

    def _tell_if_lost(self, stamp_ns: int, camera: Intrinsics) -> None:
        """Report since when tracking is lost, and what to do about it, in the log and the state; there also that given
        poses jump again and again.
        """
        known = bool(self.node.state)
        if self.last.status == "ok":
            if self.lost_since is not None and known:
                log.info("tracking recovered after %.1f s", 1e-9 * (stamp_ns - self.lost_since[0]))
            again = len(self.jumps_ns) == 2 and stamp_ns - self.jumps_ns[0] < _JUMPS_NS
            self.node.state = f"the given poses jump away from what depth shows: {GIVEN_OTHERWISE}" if again else ""
            self.lost_since, self.followed = None, True
            return
        if self.lost_since is None:
            self.lost_since, self.node.state, known = (stamp_ns, time.strftime("%H:%M:%S")), "", False
        lost_ns = stamp_ns - self.lost_since[0]
        if lost_ns >= _TOLD_NS:
            what = f"tracking lost since {self.lost_since[1]}, for {1e-9 * lost_ns:.0f} s of frames"
            advice = (
                "move the camera back to a place that it saw before"
                if self.followed
                else "no frame has been tracked yet"
            )
            doubt = off_centre(camera)
            self.node.state = f"{what}: {advice} ({self.last.reason})" + (f"; {doubt}" if doubt else "")
            if not known:
                self.node.note("lost tracking", self.node.state)

    def _tell_errors(self) -> None:
        """Report estimated errors of given poses and camera: when notable, and when changed by as much again."""
        known, delay_s = self.last.calibration, self.last.delay_s
        scale, looks = np.log([known.depth_factor]), np.array((*known.turn, *known.centre))
        for kind, now, least, text in (
            ("depth's scale", scale, depth_scale.NOTABLE, depth_scale.notice(known.depth_factor)),
            ("poses' delay", np.array([delay_s]), delay.NOTABLE_S, delay.notice(delay_s)),
            ("where the camera looks", looks, orientation.NOTABLE, orientation.notice(known)),
        ):
            if text and np.linalg.norm(now - self.told.get(kind, np.zeros(len(now)))) >= least:
                self.told[kind] = now
                self.node.note(kind, text)

    def _keep(self) -> None:
        """Write a snapshot of the tracker's map, if it has one and its stream has a name to find it by."""
        stream, epoch = self.node.stream, self.epoch
        state = self.tracker.state() if isinstance(self.tracker, MapTracker) else None
        if state is not None and stream is not None and epoch is not None:
            self.snapshots.write(snapshot_bytes(tracker_snapshot(state, stream, epoch)))
