"""The map and its objects in a file, from which another fusion process resumes."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.calibration import Calibration
from spot3d.dataflow.saved_objects import restored, same_fields, saved
from spot3d.dataflow.snapshot_file import Snapshot, SnapshotError, read_snapshot
from spot3d.found_object import FoundObject
from spot3d.fusion.fusion import Fusion, MapState
from spot3d.fusion.map.map_arrays import FREQUENCY
from spot3d.fusion.objects.balance import Piece
from spot3d.fusion.objects.cluster_judge import Described
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.growing import Growing
from spot3d.fusion.objects.identity import Identities
from spot3d.fusion.objects.recalibration import Placement
from spot3d.fusion.objects.segment_graph import SegmentGraph
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import View
from spot3d.fusion.pose_frame import PoseFrame
from spot3d.fusion.settings import FusionSettings

_KIND = "fusion"
_CLASSES = {
    kind.__name__: kind
    for kind in (
        Box3D,
        Calibration,
        Described,
        FoundObject,
        Growing,
        Identities,
        MapState,
        Piece,
        Placement,
        PoseFrame,
        SegmentGraph,
        SegmentTable,
        View,
        ViewConsensus,
    )
}
_PARTS = ("state", "consensus", "identities")
"""The parts of a fusion that are saved: its map, and the objects that belong to it."""


@dataclass(frozen=True, slots=True)
class Account:
    """Which map a snapshot is of, and how far its stream was.

    epoch: of the map; world: epoch of its poses; fused_ns: stamp of the last frame in it.
    """

    stream: str | None
    epoch: str
    world: str | None
    fused_ns: int
    fused: int
    skipped: dict[str, int]
    last_stamp_ns: int
    in_stream: int


@dataclass(frozen=True, slots=True)
class Kept:
    """What is to be saved of a fusion, once the update of the objects that was due then is made."""

    state: MapState
    consensus: ViewConsensus
    identities: Identities
    settings: FusionSettings
    account: Account


def keep(fusion: Fusion, account: Account) -> Kept:
    """The map as it is now, copied, and the objects as they will be after the update made from it."""
    return Kept(fusion.map_state(), fusion.consensus, fusion.identities, fusion.settings, account)


def fusion_snapshot(kept: Kept) -> Snapshot:
    """The snapshot; no update of the objects may run meanwhile."""
    taken, arrays = kept.state.rows[:, FREQUENCY] > 0, dict[str, NDArray[Any]]()
    state = replace(kept.state, rows=kept.state.rows[taken], keys=kept.state.keys[taken])
    values = {"voxel": kept.settings.voxel, "account": asdict(kept.account)}
    for name, part in zip(_PARTS, (state, kept.consensus.without_waiting(), kept.identities), strict=True):
        values[name] = saved(part, arrays, _CLASSES, kept.settings)
    return Snapshot(_KIND, values, arrays)


def read_account(path: Path) -> tuple[Account, Snapshot]:
    """The account of the snapshot in a file, and the rest of it for `resume`. Raises SnapshotError, OSError."""
    kept = read_snapshot(path, _KIND)
    try:
        return Account(**kept.values["account"]), kept
    except (KeyError, TypeError) as error:
        raise SnapshotError(f"{path} has no valid account of its map: {error}") from error


def resume(fusion: Fusion, kept: Snapshot, path: Path) -> None:
    """Replace map and objects by those of a snapshot, wholly or, where SnapshotError is raised, not at all."""
    arrays, values, settings = kept.arrays, kept.values, fusion.settings
    try:
        if values["voxel"] != settings.voxel:
            raise SnapshotError(
                f"{path} has voxels of {values['voxel']} m, but fusion.voxel is {settings.voxel} m; set it to the same"
            )
        state, consensus, identities = (restored(values[name], arrays, _CLASSES, settings) for name in _PARTS)
        ours = fusion.map_state(), fusion.consensus, fusion.identities
        if not all(map(same_fields, ours, (state, consensus, identities))):
            raise SnapshotError(f"{path} is of another version of spot3d")
        if (count := len(state.rows)) > settings.map_limit:
            raise SnapshotError(f"{path} has {count} points, but fusion.map_limit is {settings.map_limit}; raise it")
        as_here = state.rows.dtype == np.float32 and state.rows.shape[1:] == fusion.heatmap.arrays.rows.shape[1:]
        if not as_here or state.keys.shape != state.rows.shape[:1]:
            raise SnapshotError(f"{path} has points of another version of spot3d")
        if not state.poses.T_world_map.shape == state.poses.T_theirs_map.shape == (4, 4):
            raise SnapshotError(f"{path} lacks the pose of its map in the world")
    except SnapshotError:
        raise
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise SnapshotError(f"{path} is of another version of spot3d: {error}") from error
    fusion.resume(state, consensus, identities)
