"""A run that is over, live ones with their dropped frames included: what it wrote, beside the truth."""

from pathlib import Path

from spot3d.boxes import iou_matrix_3d
from spot3d.evaluate.labelled import DataSet, LabelledSequence
from spot3d.evaluate.measured_run import moved, that_count, world_alignment
from spot3d.evaluate.points import point_scores
from spot3d.evaluate.scores import object_scores
from spot3d.evaluate.table import Column, Table
from spot3d.evaluate.truth import LabelledScene, read_found_objects
from spot3d.source.errors import SourceError
from spot3d.trajectory import read_tum


def finished_table(dataset: DataSet, folder: Path) -> Table:
    """Overlap and points (paper, Fig. 12 and Table IV) of the objects in a run's folder.

    Raises SourceError where the data set has not one sequence with true objects and poses, and where the folder
    holds no run of it.
    """
    item, truth = _labelled(dataset)
    try:
        stamps, poses = read_tum(folder / "trajectory.txt")
        found = read_found_objects(folder / "objects.json")
    except (FileNotFoundError, ValueError) as error:
        raise SourceError(f"{folder} holds no finished run: {error}") from error
    T = world_alignment(item.sequence, list(zip(stamps, poses, strict=True)))
    every = [moved(one.box, T) for one in found]
    boxes = that_count(every, truth)
    points = [point_scores(truth.xyz, truth.label, list(chosen)) for chosen in (boxes, every)]
    table = Table(
        "run",
        f"Objects of the run in {folder}",
        (
            *(Column("data"), Column("poses"), Column("found"), Column("left out"), Column("true")),
            *(Column(f"3D {name}") for name in ("IoU", "IoU_o", "SR", "DR")),
            *(Column(name, 1) for name in ("AP", "AR", "F", "AP all", "AR all", "F all")),
        ),
        notes=[
            "The found world is moved into the true one as all trusted poses agree best.",
            "Left out of all but the last three: found boxes that meet no true object, on points that nobody labelled.",
        ],
    )
    counts = (len(stamps), len(every), len(every) - len(boxes), len(truth.boxes))
    overlap = object_scores([iou_matrix_3d(truth.boxes, boxes)]).cells()
    scores = [value for one in points for value in (one.precision, one.recall, one.f_measure)]
    table.add(item.name, *counts, *overlap, *scores)
    return table


def _labelled(dataset: DataSet) -> tuple[LabelledSequence, LabelledScene]:
    sequences = [item for item in dataset.sequences if item.sequence.has_true_poses]
    items = [(item, item.truth) for item in sequences if item.truth is not None]
    if len(items) != 1:
        raise SourceError(
            f"{dataset.name} has {len(items)} sequences with true objects and poses; name the one that was run"
        )
    return items[0]
