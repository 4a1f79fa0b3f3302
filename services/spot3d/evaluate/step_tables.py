"""What each step of the finder of single frames is worth: the table without one of them at a time."""

from typing import get_args

import numpy as np

from spot3d.boxes import detection_rate, mean_iou, success_rate
from spot3d.evaluate.frame_tables import boxes_in_frame, proposals_and_heat
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.scores import without_object
from spot3d.evaluate.table import Column, Table
from spot3d.evaluate.unjudged import judged_overlap
from spot3d.segments.settings import Step
from spot3d.settings import Settings


def steps_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Success and detection rate at IoU 0.5 and mean IoU of single frames, whole and without one step each."""
    columns = (Column("data"), Column("without"), Column("SR"), Column("DR"), Column("IoU"))
    table = Table(
        "steps",
        "Single frame: without one step of the finder each",
        (*columns, Column("a frame", 1), Column("no object", 1), Column("true a frame", 1)),
    )
    variants = {"-": settings} | {step: _without(step, settings) for step in get_args(Step)}
    for dataset in datasets:
        if dataset.frames is None:
            continue
        overlap = {name: list[np.ndarray]() for name in variants}
        for item in (dataset.frames.read(index) for index in range(dataset.frames.count)):
            _, heat = proposals_and_heat(item.frame, settings)
            for name, changed in variants.items():
                overlap[name].append(judged_overlap(item, boxes_in_frame(item.frame, heat, changed))[0])
        for name, found in overlap.items():
            a_frame, true = (float(np.mean([matrix.shape[axis] for matrix in found])) for axis in (1, 0))
            rates = (success_rate(found), detection_rate(found), mean_iou(found))
            table.add(dataset.name, name, *rates, a_frame, without_object(found), true)
    table.notes.append("The steps are those of `segments.skipped`; a rule that is worth nothing anywhere has no place.")
    return table


def _without(step: Step, settings: Settings) -> Settings:
    return settings.model_copy(update={"segments": settings.segments.model_copy(update={"skipped": (step,)})})
