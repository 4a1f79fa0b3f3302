"""The map and its objects in a file, from which another process of fusion goes on."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.calibration import Calibration
from spot3d.camera import Intrinsics
from spot3d.dataflow.ledger import Ledger
from spot3d.dataflow.saved_objects import restored, same_fields, saved
from spot3d.dataflow.snapshot_file import Snapshot, SnapshotError, read_snapshot
from spot3d.found_object import FoundObject
from spot3d.fusion.fusion import Fusion, MapState
from spot3d.fusion.map.map_arrays import FREQUENCY
from spot3d.fusion.objects.balance import Piece
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.growing import Growing
from spot3d.fusion.objects.identity import Identities
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.recalibration import Placement
from spot3d.fusion.objects.segment_graph import SegmentGraph
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import View
from spot3d.fusion.settings import FusionSettings

_KIND = "fusion"
_CLASSES = {
    kind.__name__: kind
    for kind in (
        Box3D,
        Calibration,
        FoundObject,
        Growing,
        Identities,
        Intrinsics,
        Keyframe,
        Piece,
        Placement,
        SegmentGraph,
        SegmentTable,
        View,
        ViewConsensus,
    )
}


@dataclass(frozen=True, slots=True)
class Account:
    """Which map a snapshot is of, and how far its stream was.

    epoch: of the map; world: of its poses; fused_ns: stamp of the last frame in it.
    """

    stream: str | None
    epoch: str
    world: str | None
    fused_ns: int
    fused: int
    skipped: dict[str, int]
    last_stamp_ns: int
    in_stream: int


def account(stream: str | None, epoch: str, world: str | None, fused_ns: int, ledger: Ledger) -> Account:
    """The account of a map whose stream's ledger this is."""
    skipped = dict(ledger.skipped)
    return Account(stream, epoch, world, fused_ns, ledger.fused, skipped, ledger.last_stamp_ns, ledger.in_stream)


@dataclass(frozen=True, slots=True)
class Kept:
    """What is to be kept of a fusion, once the update of the objects is made that was due at that moment."""

    state: MapState
    consensus: ViewConsensus
    identities: Identities
    settings: FusionSettings
    told: Account


def keep(fusion: Fusion, told: Account) -> Kept:
    """The map as it is now, copied, and the objects as they will be after the update that is made of it."""
    return Kept(fusion.map_state(), fusion.consensus, fusion.identities, fusion.settings, told)


def fusion_snapshot(kept: Kept) -> Snapshot:
    """The snapshot; no update of the objects may be made meanwhile."""
    state, settings = kept.state, kept.settings
    taken = state.rows[:, FREQUENCY] > 0
    arrays: dict[str, NDArray[Any]] = {"rows": state.rows[taken], "keys": state.keys[taken]}
    arrays |= {"removed": state.removed, "candidates": state.candidates, "T_world_map": state.T_world_map}
    arrays["T_theirs_map"] = state.T_theirs_map
    if state.supporting is not None:
        arrays["supporting"] = state.supporting
    values = {
        "voxel": settings.voxel,
        "evicted": state.evicted,
        "frame_count": state.frame_count,
        "poses_of": state.poses_of,
        "calibration": saved(state.calibration, arrays, _CLASSES, settings),
        "calibrated_by": state.calibrated_by,
        "account": {name: getattr(kept.told, name) for name in Account.__slots__},
        "consensus": saved(kept.consensus.without_waiting(), arrays, _CLASSES, settings),
        "identities": saved(kept.identities, arrays, _CLASSES, settings),
    }
    return Snapshot(_KIND, values, arrays)


def read_account(path: Path) -> tuple[Account, Snapshot]:
    """The account of the snapshot in a file, and the rest of it for `resume`. Raises SnapshotError, OSError."""
    kept = read_snapshot(path, _KIND)
    try:
        return Account(**kept.values["account"]), kept
    except (KeyError, TypeError) as error:
        raise SnapshotError(f"{path} has no account of its map: {error}") from error


def resume(fusion: Fusion, kept: Snapshot, path: Path) -> None:
    """Make the map and the objects those of a snapshot, wholly or, where that raises SnapshotError, not at all."""
    arrays, values, settings = kept.arrays, kept.values, fusion.settings
    try:
        if values["voxel"] != settings.voxel:
            raise SnapshotError(f"{path} has voxels of {values['voxel']} m, and fusion.voxel is {settings.voxel} m")
        if len(arrays["rows"]) > settings.map_limit:
            count = len(arrays["rows"])
            raise SnapshotError(f"{path} has {count} points, and fusion.map_limit is {settings.map_limit}: raise it")
        consensus = restored(values["consensus"], arrays, _CLASSES, settings)
        identities = restored(values["identities"], arrays, _CLASSES, settings)
        for ours, theirs in ((fusion.consensus, consensus), (fusion.identities, identities)):
            if not same_fields(ours, theirs):
                raise SnapshotError(f"{path} is of another version of spot3d")
        state = MapState(
            rows=arrays["rows"],
            keys=arrays["keys"],
            evicted=int(values["evicted"]),
            frame_count=int(values["frame_count"]),
            removed=arrays["removed"],
            candidates=arrays["candidates"],
            supporting=arrays.get("supporting"),
            T_world_map=arrays["T_world_map"],
            poses_of=values["poses_of"],
            T_theirs_map=arrays["T_theirs_map"],
            calibration=restored(values["calibration"], arrays, _CLASSES, settings),
            calibrated_by=values["calibrated_by"],
        )
        if state.rows.ndim != 2 or state.rows.shape[1:] != fusion.heatmap.arrays.rows.shape[1:]:
            raise SnapshotError(f"{path} has points of another version of spot3d")
        if not state.T_world_map.shape == state.T_theirs_map.shape == (4, 4):
            raise SnapshotError(f"{path} has no place of its map in the world")
        if state.keys.shape != state.rows.shape[:1] or state.rows.dtype != np.float32:
            raise SnapshotError(f"{path} has points of another version of spot3d")
    except SnapshotError:
        raise
    except (KeyError, ValueError, TypeError) as error:
        raise SnapshotError(f"{path} is of another version of spot3d: {error}") from error
    fusion.resume(state, consensus, identities)
