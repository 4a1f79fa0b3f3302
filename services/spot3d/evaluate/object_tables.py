"""Tables of the objects that a whole run finds: overlap, ablations (Table III), points (Table IV), stability."""

import numpy as np

from spot3d.evaluate.datasets import both_sizes
from spot3d.evaluate.frame_tables import with_proposals
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.measured_run import MeasuredRun, Runs
from spot3d.evaluate.points import mean_point_scores, point_scores
from spot3d.evaluate.scores import object_scores, recall_of
from spot3d.evaluate.stability import stability
from spot3d.evaluate.table import Cell, Column, Table
from spot3d.settings import Settings

OVERLAP = tuple(Column(f"{space} {name}") for space in ("2D", "3D") for name in ("IoU", "IoU_o", "SR", "DR"))
OVERLAP += (Column("3D SR all"), Column("left out", 1))


def objects_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """2D and 3D overlap of the objects found, at VGA and half size, with recall curves (paper, Fig. 12)."""
    columns: tuple[Column, ...] = (Column("data"), Column("size"), *OVERLAP, Column("found", 1), Column("true", 1))
    table = Table("objects", "Objects of whole runs: overlap with the true ones (paper, Fig. 12)", columns)
    for dataset, size in both_sizes(datasets):
        done = _runs_of(dataset, settings, runs)
        if done:
            found, true = (float(np.mean([run.iou_3d.shape[axis] for run in done])) for axis in (1, 0))
            table.add(dataset.name, size, *_overlap(done), found, true)
            table.curves += [
                recall_of(dataset.name, f"2D {size}", [matrix for run in done for matrix in run.iou_2d]),
                recall_of(dataset.name, f"3D {size}", [run.iou_3d for run in done]),
            ]
    _note_overlap(table, settings)
    return table


def ablations_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """2D and 3D overlap without one step each, and with all (paper, Table III)."""
    columns: tuple[Column, ...] = (Column("data"), Column("method"), *OVERLAP)
    table = Table("ablations", "Ablations: overlap without one step each (paper, Table III)", columns)
    for dataset in datasets:
        for name, changed in ablations(settings).items():
            done = _runs_of(dataset, changed, runs)
            if done:
                table.add(dataset.name, name, *_overlap(done))
    table.notes.append("Without the hard filter, windows are not culled by their metric size either.")
    _note_overlap(table, settings)
    return table


def ablations(settings: Settings) -> dict[str, Settings]:
    """The paper's ablations by name, and the whole method last."""

    def without(soft: bool, hard: bool) -> Settings:
        heatmap = settings.heatmap.model_copy(update={"soft_filter": soft, "hard_filter": hard})
        # Culling applies the hard filter's limits to the search already: it goes with it.
        culling = hard and settings.proposals.metric_culling
        return with_proposals(settings.model_copy(update={"heatmap": heatmap}), metric_culling=culling)

    fusion = settings.fusion.model_copy(update={"plane_removal": False})
    return {
        "noHmap": without(soft=False, hard=False),
        "noSFilt": without(soft=False, hard=True),
        "noHFilt": without(soft=True, hard=False),
        "noPlRem": settings.model_copy(update={"fusion": fusion}),
        "whole": settings,
    }


def points_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """AP, AR and F of labelled points in the objects' boxes, and time (paper, Table IV)."""
    columns = (
        Column("data"),
        Column("size"),
        Column("AP", 1),
        Column("AR", 1),
        Column("F", 1),
        Column("ms a frame", 1),
    )
    table = Table("points", "Labelled points in the boxes, and time (paper, Table IV)", columns)
    for dataset, size in both_sizes(datasets):
        scores, times = [], []
        for item in dataset.sequences:
            if item.truth is None or not len(item.truth.label):
                continue
            run = runs.run(item, settings)
            scores.append(point_scores(item.truth.xyz, item.truth.label, run.boxes))
            times.append(run.frame_ms())
            if len(dataset.sequences) > 1:
                last = scores[-1]
                table.add(item.name, size, last.precision, last.recall, last.f_measure, times[-1])
        if scores:
            mean = scores[0] if len(scores) == 1 else mean_point_scores(scores)
            name = dataset.name if len(scores) == 1 else f"{dataset.name}, mean"
            table.add(name, size, mean.precision, mean.recall, mean.f_measure, float(np.mean(times)))
    table.notes.append(f"Poses: {settings.pose.provider}. Time: all stages but reading, one after the other.")
    return table


def stability_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """Switches of id and jitter of boxes over a run, for each true object (not in the paper)."""
    columns: tuple[Column, ...] = (Column("data"), Column("object"), Column("id switches"), Column("matched %", 0))
    columns += (Column("centre jitter mm", 1), Column("size jitter mm", 1))
    table = Table("stability", "How steady the objects are over a run", columns)
    for item in (item for dataset in datasets for item in dataset.sequences):
        truth = item.truth
        if truth is None:
            continue
        run = runs.run(item, settings)
        steady = stability(run.updates, truth.boxes)
        for row, name in enumerate(truth.names):
            jitter = (1e3 * float(steady.centre_jitter[row]), 1e3 * float(steady.size_jitter[row]))
            table.add(item.name, name, int(steady.id_switches[row]), 100 * float(steady.matched[row]), *jitter)
    table.notes.append(
        "Matched: share of updates with a box of IoU 0.25 or more; jitter: median change from one update to the next, "
        f"last half of the run. Poses: {settings.pose.provider}."
    )
    return table


def _runs_of(dataset: DataSet, settings: Settings, runs: Runs) -> list[MeasuredRun]:
    return [runs.run(item, settings) for item in dataset.sequences if item.truth is not None]


def _overlap(done: list[MeasuredRun]) -> tuple[Cell, ...]:
    flat = object_scores([matrix for run in done for matrix in run.iou_2d])
    hits, everything = np.sum([run.success_of_all() for run in done], axis=0)
    all_success = float(hits / everything) if everything else None
    left_out = float(np.mean([run.ignored for run in done]))
    return *flat.cells(), *object_scores([run.iou_3d for run in done]).cells(), all_success, left_out


def _note_overlap(table: Table, settings: Settings) -> None:
    table.notes += [
        "IoU: mean over true objects; IoU_o: mean over found ones; SR, DR: success and detection rate at IoU 0.5. "
        f"2D: boxes around projected points, about 50 views. Poses: {settings.pose.provider}.",
        "Left out: found boxes that meet no true object, on points whose label says `ignore` (nobody labelled what "
        "is there). SR all counts them as false, as the paper does with whatever is not labelled an object.",
    ]
