"""Snapshot file of the tracker's world, in which a restarted pose stage relocalises."""

from pathlib import Path

import numpy as np

from spot3d.dataflow.snapshot_file import Snapshot, SnapshotError, read_snapshot
from spot3d.pose.landmark_map import LANDMARK
from spot3d.pose.surfel_map import HELD, VOXEL
from spot3d.pose.tracking import TrackerState
from spot3d_schemas.limits import BEND_SHAPE

_KIND = "pose"


def tracker_snapshot(state: TrackerState, stream: str, epoch: str) -> Snapshot:
    """The snapshot of a tracker that follows `stream` in the world `epoch`."""
    values = {"stream": stream, "epoch": epoch, "stamp_ns": state.stamp_ns, "surfel_voxel": VOXEL}
    landmarks = {f"landmark {name}": np.ascontiguousarray(state.landmarks[name]) for name in LANDMARK.names or ()}
    bend = np.array(state.bend).reshape(-1, BEND_SHAPE[1])
    arrays = {"T_world_camera": state.T_world_camera, "keys": state.keys, "surfels": state.surfels, "bend": bend}
    arrays |= landmarks
    return Snapshot(_KIND, values, arrays)


def read_tracker(path: Path, stream: str) -> tuple[TrackerState, str] | None:
    """The tracker's state and epoch of this stream; None where the snapshot is of another stream, or there is none.

    Raises SnapshotError where the file is no complete snapshot of a tracker, OSError.
    """
    if not path.exists():
        return None
    kept = read_snapshot(path, _KIND)
    if kept.values.get("stream") != stream:
        return None
    try:
        if kept.values["surfel_voxel"] != VOXEL:
            raise SnapshotError(f"{path} has surfels of {kept.values['surfel_voxel']} m, not {VOXEL} m")
        arrays = kept.arrays
        landmarks = np.zeros(len(arrays["landmark last"]), LANDMARK)
        for name in LANDMARK.names or ():
            landmarks[name] = arrays[f"landmark {name}"]
        keys, surfels, pose = arrays["keys"], arrays["surfels"], arrays["T_world_camera"]
        bend = arrays["bend"]
        if surfels.shape != (len(keys), HELD) or pose.shape != (4, 4) or (len(bend) and bend.shape != BEND_SHAPE):
            raise SnapshotError(f"{path} has arrays of wrong shapes")
        known = tuple(tuple(row) for row in bend.tolist())
        state = TrackerState(int(kept.values["stamp_ns"]), pose, keys, surfels, landmarks, known)
        return state, str(kept.values["epoch"])
    except (KeyError, ValueError) as error:
        if isinstance(error, SnapshotError):
            raise
        raise SnapshotError(f"{path} lacks a part of the tracker's state: {error}") from error
