"""The fusion stage's process: joins heat, poses and segments, fuses them, and publishes objects and progress."""

import threading
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np

from spot3d.camera_pose import CameraPose
from spot3d.dataflow.node import Node
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.warm_up import warm_up
from spot3d.frame import RgbdFrame
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.map_answers import MapAnswers
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.snapshot_keeper import SnapshotKeeper, resumed
from spot3d.fusion.stage import INPUTS, OUTPUTS, QUERIES, Stage
from spot3d.fusion.updates import Updates


def run(
    link: LinkSettings,
    settings: FusionSettings,
    stop: threading.Event | None = None,
    resume: Path | None = None,
    keep_last: bool = True,
) -> None:
    """Fuse every frame whose heat and pose come, until stopped by `stop`, SIGINT or SIGTERM.

    Publishes progress for every frame, the objects at the cadence of capture time, and both once more when a stream is
    complete. Answers `fusion/map` (parameter `limit`: most points), `fusion/changes` (see `MapChanges`) and
    `fusion/reset`. Another stream of frames, or another epoch of poses, is another scene: the map and the object
    numbers restart.
    The map is saved to a file, at the end too if `keep_last`, and a fusion restarted within a stream resumes from it.
    resume: the snapshot of an earlier map, with poses of the same world, from which the first stream resumes. Raises
    SnapshotError if that file is none.
    """
    fusion = Fusion(settings)
    account = None if resume is None else resumed(fusion, resume)
    warm_up("fusion", partial(_fuse_all, Fusion(settings)))
    with stop_on_signals(stop) as stopped:
        with (
            Node("fusion", link, stopped, INPUTS, OUTPUTS, QUERIES) as node,
            closing(SnapshotKeeper(node)) as keeper,
            closing(Updates(node, keeper)) as updates,
            closing(MapAnswers(node)) as answers,
        ):
            stage = Stage(node, fusion, keeper, updates, answers, account)
            stage.serve()
        if keep_last:
            stage.keep_last()


def _fuse_all(fusion: Fusion, frames: Sequence[RgbdFrame]) -> None:
    for frame in frames:
        depth = frame.depth_metres()
        heat = np.where(np.abs(depth - 0.8) < 0.01, 255, 0).astype(np.uint8)
        pose = np.eye(4) if frame.T_world_camera is None else frame.T_world_camera
        fusion.fuse(frame.colour, depth, heat, frame.intrinsics, CameraPose(pose), frame.stamp_ns)
        labels, confidence = (heat > 0).astype(np.uint8), np.ones(1, np.float32)
        wall, on_it = np.array([[0.0, 0.0, -1.0, 1.2]]), np.zeros(1, np.int8)
        fusion.observe(FrameSegments(labels, confidence, wall, on_it, frame.intrinsics), frame.stamp_ns)
    fusion.objects()
    # Kernels for a full map and a snapshot, which few frames do not call.
    fusion.heatmap.restore(*fusion.heatmap.held())
    fusion.heatmap.evict(1, fusion.settings.tau)
