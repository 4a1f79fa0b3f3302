"""Tables of the objects that whole runs find: overlap, ablations (Table III), points (Table IV), stability."""

from typing import get_args

import numpy as np
from numpy.typing import NDArray

from spot3d.evaluate.datasets import both_sizes
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.measured_run import Measured, MeasuredRun, Runs
from spot3d.evaluate.peer import PEER, RADIUS, RANGE_MAX, behind_peer
from spot3d.evaluate.peer_map import FRAMES_MAX, VOXEL
from spot3d.evaluate.points import mean_point_scores
from spot3d.evaluate.scores import object_scores, recall_of, without_object
from spot3d.evaluate.stability import stability
from spot3d.evaluate.table import Cell, Column, Table, columns
from spot3d.fusion.settings import Vote
from spot3d.segments.settings import Step
from spot3d.settings import Settings

OURS = "spot3d"
OVERLAP = (
    *columns("2D IoU", "2D IoU_o", "2D SR", "2D DR", "3D IoU", "3D IoU_o", "3D SR", "3D DR", "3D SR all"),
    *columns("left out", "no object", digits=1),
)
CARRIED = columns("carried IoU", "carried IoU_o", "carried SR", "carried DR")
POSES = (Column("ATE mm", 1), Column("lost %", 0))
POINTS = ("AP", "AR", "F", "carried AP", "carried AR", "carried F")
NOTE_CARRIED = (
    "Carried: judged in the run's own world, into which the frames that see a true object carry it (median), its "
    "points with it and every other point with the nearest object; beside it, the run's world moved as a whole."
)
NOTE_POSES = (
    "ATE: root mean square distance of the run's tracked cameras to the true ones, after rigid alignment; lost: "
    "frames without a pose. A world that jumps affects these, not the carried numbers."
)
NOTE_NO_OBJECT = "No object: boxes that count, of a scene, and overlap every true object by less than IoU 0.25."
NOTE_PEER = (
    f"{PEER}: points of up to {FRAMES_MAX} frames with the run's poses, and depth up to {RANGE_MAX:g} m as the run has "
    f"corrected it, in voxels of {100 * VOXEL:g} cm, dominant planes taken away, clusters of radius {100 * RADIUS:g} "
    "cm, upright boxes within the same limits of size."
)


def objects_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """2D and 3D overlap of the objects found, at VGA and half size, with recall curves (paper, Fig. 10)."""
    heads = (*columns("data", "size", "method"), *OVERLAP, *CARRIED, *columns("found", "true", digits=1), *POSES)
    table = Table("objects", "Objects of whole runs: overlap with the true ones (paper, Fig. 10)", heads)
    for dataset, size in both_sizes(datasets):
        done = _runs_of(dataset, settings, runs)
        methods = by_method(done)
        for method, one in methods.items():
            found, true = (float(np.mean([each.fixed.iou.shape[axis] for each in one])) for axis in (1, 0))
            carried = object_scores([each.carried.iou for each in one])
            table.add(dataset.name, size, method, *_overlap(one), *carried, found, true, *pose_cells(done))
            table.curves += [
                recall_of(dataset.name, f"2D {size} {method}", [matrix for each in one for matrix in each.iou_2d]),
                recall_of(dataset.name, f"3D {size} {method}", [each.fixed.iou for each in one]),
            ]
        table.notes += behind_peer(f"{dataset.name} at {size}", overlap_measures(*methods.values()))
    _note_overlap(table, settings)
    table.notes += [NOTE_CARRIED, NOTE_POSES]
    return table


def ablations_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """2D and 3D overlap without one step at a time, of the whole method (paper, Table III), and of the peer."""
    heads = (*columns("data", "method"), *OVERLAP)
    table = Table("ablations", "Ablations: overlap without one step each (paper, Table III)", heads)
    for dataset in datasets:
        for name, changed in ablations(settings).items():
            table.add(dataset.name, name, *_overlap([run.ours for run in _runs_of(dataset, changed, runs)]))
        methods = by_method(_runs_of(dataset, settings, runs))
        table.add(dataset.name, PEER, *_overlap(methods[PEER]))
        table.notes += behind_peer(f"{dataset.name}, whole", overlap_measures(*methods.values()))
    table.notes += [
        "Without the hard filter, windows are not culled by their metric size either.",
        "noFlying: depth between two surfaces is kept; noRecent: holes in depth are not filled from earlier frames; "
        "noShare: what only few views show as an object counts as one; noCorr: given poses are not corrected. Other "
        "rows leave out a step of the finder (`segments.skipped`) or a rule of the consensus (`fusion.skipped`).",
    ]
    _note_overlap(table, settings)
    return table


def ablations(settings: Settings) -> dict[str, Settings]:
    """The paper's ablations by name, those of additional steps, and the whole method last."""

    def without(soft: bool, hard: bool) -> Settings:
        # Culling applies the hard filter's limits to the search, so it is switched off with it.
        culling = hard and settings.proposals.metric_culling
        filtered = settings.changed("heatmap", soft_filter=soft, hard_filter=hard)
        return filtered.changed("proposals", metric_culling=culling)

    steps = [step for step in get_args(Step) if step != "support"]
    return {
        "noHmap": without(soft=False, hard=False),
        "noSFilt": without(soft=False, hard=True),
        "noHFilt": without(soft=True, hard=False),
        "noPlRem": settings.changed("fusion", plane_removal=False).changed("segments", skipped=("support",)),
        "noFlying": settings.changed("fusion", grazing_cos=0.0).changed("segments", grazing_cos=0.0),
        "noRecent": settings.changed("segments", recent_frames=0),
        "noShare": settings.changed("fusion", object_share=0.0),
        "noCorr": settings.changed("pose", given_sigma=0.0),
        **{f"without {step}": settings.changed("segments", skipped=(step,)) for step in steps},
        **{f"without {rule}": settings.changed("fusion", skipped=(rule,)) for rule in get_args(Vote)},
        "whole": settings,
    }


def pose_cells(runs: list[MeasuredRun]) -> tuple[Cell, Cell]:
    """Means over the runs, for the columns POSES."""
    return 1e3 * float(np.mean([run.ate for run in runs])), 100 * float(np.mean([run.lost for run in runs]))


def points_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """AP, AR and F of labelled points in the objects' boxes, and time (paper, Table IV)."""
    heads = (*columns("data", "size", "method"), *columns(*POINTS, "no object", digits=1), *POSES)
    heads += columns("ms a frame", digits=1)
    table = Table("points", "Labelled points in the boxes, and time (paper, Table IV)", heads)
    for dataset, size in both_sizes(datasets):
        items = [item for item in dataset.sequences if item.truth is not None and len(item.truth.label)]
        done = {item.name: runs.run(item, settings) for item in items}
        several = {f"{dataset.name}, mean": list(done.values())} if len(done) > 1 else {}
        for name, some in ({name: [run] for name, run in done.items()} | several).items():
            methods, ms = by_method(some), float(np.mean([run.frame_ms() for run in some]))
            for method, one in methods.items():
                time = ms if method == OURS else None
                table.add(name, size, method, *point_cells(one), without_object(_fixed(one)), *pose_cells(some), time)
            table.notes += behind_peer(f"{name} at {size}", point_measures(*methods.values()))
    table.notes += [
        f"Poses: {settings.pose.provider}. Time: all stages except reading, one after the other.",
        NOTE_NO_OBJECT,
        NOTE_CARRIED,
        NOTE_POSES,
    ]
    return table


def stability_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """Id switches and jitter of boxes over a run, for each true object (not in the paper)."""
    heads = (*columns("data", "object", "id switches"), Column("matched %", 0))
    heads += columns("centre jitter mm", "size jitter mm", digits=1)
    table = Table("stability", "How steady the objects are over a run", heads)
    for item in (item for dataset in datasets for item in dataset.sequences):
        truth = item.truth
        if truth is None:
            continue
        run = runs.run(item, settings)
        for name, one in zip(truth.names, stability(run.updates, truth.boxes), strict=True):
            jitter = (1e3 * one.centre_jitter, 1e3 * one.size_jitter)
            table.add(item.name, name, one.id_switches, 100 * one.matched, *jitter)
        ids = {number for update in run.updates for number, _ in update}
        last = len(run.updates[-1]) if run.updates else 0
        strays = int(without_object([run.ours.fixed.iou]))
        table.notes.append(
            f"{item.name}: {len(ids)} ids given in {len(run.updates)} updates, {last} objects in the last one; "
            f"{strays} counted boxes match no true object."
        )
    table.notes.append(
        "Matched: share of updates with a box of IoU 0.25 or more; jitter: median change from one update to the next, "
        f"last half of the run. Poses: {settings.pose.provider}."
    )
    return table


def _runs_of(dataset: DataSet, settings: Settings, runs: Runs) -> list[MeasuredRun]:
    return [runs.run(item, settings) for item in dataset.sequences if item.truth is not None]


def by_method(runs: list[MeasuredRun]) -> dict[str, list[Measured]]:
    """The objects of ours and of the peer in these runs, in this order."""
    return {OURS: [run.ours for run in runs], PEER: [run.peer for run in runs]}


def overlap_measures(ours: list[Measured], peer: list[Measured]) -> list[tuple[str, float, float]]:
    """Success and detection rate in both worlds, of ours and of the peer, for `behind_peer`."""
    measures = []
    for world, matrices in (("", _fixed), ("carried ", _carried)):
        a, b = object_scores(matrices(ours)), object_scores(matrices(peer))
        measures += [(f"{world}success", a.success, b.success), (f"{world}detection", a.detection, b.detection)]
    return measures


def point_measures(ours: list[Measured], peer: list[Measured]) -> list[tuple[str, float, float]]:
    """F of the labelled points in both worlds, of ours and of the peer, for `behind_peer`."""
    (*_, fixed, _, _, carried), (*_, peer_fixed, _, _, peer_carried) = point_cells(ours), point_cells(peer)
    return [("F", fixed, peer_fixed), ("carried F", carried, peer_carried)]


def _fixed(done: list[Measured]) -> list[NDArray[np.float64]]:
    return [one.fixed.iou for one in done]


def _carried(done: list[Measured]) -> list[NDArray[np.float64]]:
    return [one.carried.iou for one in done]


def point_cells(done: list[Measured]) -> list[float]:
    """Mean point scores in the order of POINTS."""
    cells = list[float]()
    for scores in ([one.fixed.points for one in done], [one.carried.points for one in done]):
        mean = scores[0] if len(scores) == 1 else mean_point_scores(scores)
        cells += mean
    return cells


def _overlap(done: list[Measured]) -> tuple[Cell, ...]:
    flat = object_scores([matrix for one in done for matrix in one.iou_2d])
    hits, everything = np.sum([one.fixed.success_of_all() for one in done], axis=0)
    all_success = float(hits / everything) if everything else None
    left_out = float(np.mean([one.fixed.left_out for one in done]))
    return *flat, *object_scores(_fixed(done)), all_success, left_out, without_object(_fixed(done))


def _note_overlap(table: Table, settings: Settings) -> None:
    table.notes += [
        "IoU: mean over true objects; IoU_o: mean over found ones; SR, DR: success and detection rate at IoU 0.5. "
        f"2D: boxes around projected points, about 50 views. Poses: {settings.pose.provider}.",
        "Left out: found boxes that overlap no true object, on points labelled `ignore` (unknown). SR all counts "
        "them as false, as the paper does with all that is not labelled an object.",
        NOTE_NO_OBJECT,
        NOTE_PEER,
    ]
