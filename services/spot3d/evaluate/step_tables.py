"""The worth of each step of the single-frame finder: results without one of them at a time."""

from typing import get_args

from spot3d.boxes import mean_iou
from spot3d.evaluate.frame_tables import FoundInFrames, boxes_in_frame, proposals_and_heat
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.table import Table, columns
from spot3d.segments.settings import Step
from spot3d.settings import Settings


def steps_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Success and detection rate at IoU 0.5 and mean IoU of single frames, with all steps and without one at a time."""
    heads = (*columns("data", "without", "SR", "DR", "IoU"), *columns("a frame", "no object", "true a frame", digits=1))
    table = Table("steps", "Single frame: without one step of the finder each", heads)
    variants = {"-": settings} | {step: settings.changed("segments", skipped=(step,)) for step in get_args(Step)}
    for dataset in datasets:
        found = {name: FoundInFrames() for name in variants}
        for item in dataset.frames:
            _, heat = proposals_and_heat(item.frame, settings)
            for name, changed in variants.items():
                found[name].add(item, boxes_in_frame(item.frame, heat, changed))
        for name, one in found.items():
            success, detection, a_frame, no_object, _ = one.cells()
            table.add(dataset.name, name, success, detection, mean_iou(one.iou), a_frame, no_object, one.true)
    table.notes.append("The steps are those of `segments.skipped`.")
    return table
