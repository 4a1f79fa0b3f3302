"""Evaluates a finished run, also a live one with dropped frames: its results against the truth and the peer's."""

import json
from pathlib import Path

from spot3d.calibration import Calibration
from spot3d.camera import invert
from spot3d.evaluate.carried import Sightings
from spot3d.evaluate.judgement import Found, judge
from spot3d.evaluate.labelled import DataSet, LabelledSequence
from spot3d.evaluate.measured_run import Measured, world_alignment
from spot3d.evaluate.object_tables import (
    CARRIED,
    NOTE_CARRIED,
    NOTE_NO_OBJECT,
    NOTE_PEER,
    OURS,
    overlap_measures,
    point_measures,
)
from spot3d.evaluate.peer import PEER, behind_peer
from spot3d.evaluate.peer_map import FRAMES_MAX, PeerMap
from spot3d.evaluate.scores import object_scores, without_object
from spot3d.evaluate.table import Table, columns
from spot3d.evaluate.truth import LabelledScene, read_found_boxes
from spot3d.file_errors import in_words
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.trajectory import read_tum

COLUMNS = (
    *columns("data", "method", "poses", "found", "left out", "no object", "true"),
    *columns("3D IoU", "3D IoU_o", "3D SR", "3D DR"),
    *columns("AP", "AR", "F", "AP all", "AR all", "F all", digits=1),
    *CARRIED,
    *columns("carried AP", "carried AR", "carried F", digits=1),
)


def finished_table(dataset: DataSet, folder: Path, settings: Settings) -> Table:
    """Overlap and points (paper, Fig. 10 and Table IV) of the objects in a run's folder, and of the peer.

    At most 300 of the run's frames are read again, for the peer's cloud and to find the frames that see the true
    objects. `settings` give the peer's limits. Raises SourceError if the data set has not exactly one sequence with
    true objects and poses, or the folder holds no run of it.
    """
    item, truth = _labelled(dataset)
    try:
        stamps, poses = read_tum(folder / "trajectory.txt")
        boxes = read_found_boxes(folder / "objects.json")
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        x, y = report["centre"]
        bend = tuple(tuple(float(at) for at in row) for row in report.get("bend", ()))
        known = Calibration(float(report["depth_factor"]), centre=(float(x), float(y)), bend=bend)
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = in_words(error) if isinstance(error, OSError) else error
        raise SourceError(f"{folder} does not contain a finished run: {reason}") from error
    T = world_alignment(item.sequence, list(zip(stamps, poses, strict=True)))
    index_of = {stamp: index for index, stamp in enumerate(item.sequence.stamps_ns)}
    played = [(index_of[stamp], pose) for stamp, pose in zip(stamps, poses, strict=True) if stamp in index_of]
    played = played[:: -(-len(played) // FRAMES_MAX)]
    peer, sightings = PeerMap(len(played)), Sightings(truth)
    for index, pose in played:
        frame, true_pose = item.sequence[index], item.sequence.true_pose(index)
        depth, camera = known.metres(frame.depth_metres()), known.camera(frame.intrinsics)
        peer.add(depth, camera, pose)
        if true_pose is not None:
            sightings.add(depth, camera, true_pose, pose)
    carried = sightings.carried(invert(T))
    table = Table("run", f"Objects of the run in {folder}", COLUMNS)
    methods = {OURS: Found(boxes, ()), PEER: peer.found(settings.fusion)}
    done = []
    for method, found in methods.items():
        fixed, bent = judge(found.moved(T).boxes, truth), judge(found.boxes, carried)
        counts = (len(stamps), len(found.boxes), fixed.left_out, int(without_object([fixed.iou])), len(truth.boxes))
        fixed_cells = (*object_scores([fixed.iou]), *fixed.points, *fixed.points_of_all)
        table.add(item.name, method, *counts, *fixed_cells, *object_scores([bent.iou]), *bent.points)
        done.append([Measured(fixed, bent, [])])
    table.notes += behind_peer(item.name, [*overlap_measures(*done), *point_measures(*done)])
    table.notes += [
        "The run's world is aligned with the true one so that all trusted poses agree best.",
        "Left out, except from the columns with `all`: found boxes that overlap no true object, on points without a "
        "label.",
        NOTE_NO_OBJECT,
        NOTE_CARRIED,
        NOTE_PEER,
    ]
    return table


def _labelled(dataset: DataSet) -> tuple[LabelledSequence, LabelledScene]:
    sequences = [item for item in dataset.sequences if item.sequence.has_true_poses]
    items = [(item, item.truth) for item in sequences if item.truth is not None]
    if not items:
        raise SourceError(f"{dataset.name} has no sequence with both true objects and true poses")
    if len(items) > 1:
        raise SourceError(
            f"{dataset.name} has {len(items)} sequences with true objects and poses; name the one that was run"
        )
    return items[0]
