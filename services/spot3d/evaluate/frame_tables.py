"""Tables of single frames: success and detection over the number of proposals (Table I), rates of the filters."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import detection_rate, iou_matrix_2d, success_rate
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.scores import recall_of
from spot3d.evaluate.table import Column, Table
from spot3d.frame import RgbdFrame
from spot3d.heatmap.heat import Heat, weighted_heat
from spot3d.proposals.propose import propose
from spot3d.segments.single_frame import find_in_frame
from spot3d.settings import Settings

NUMBERS = (50, 100, 500, 1000, 2000)
"""Input proposals of the paper's Table I."""


def proposals_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Success (SR) and detection rate (DR) at IoU 0.5 of the bare boxes and of ours (paper, Table I).

    Ours: filter the proposals by depth, remove the supporting plane, cluster, and box each cluster's pixels.
    """
    columns: tuple[Column, ...] = (
        Column("data"),
        Column("proposals"),
        Column("boxes SR"),
        Column("boxes DR"),
        Column("ours SR"),
    )
    columns += (Column("ours DR"), Column("ours a frame", 1), Column("true a frame", 1))
    table = Table("proposals", "Single frame: success and detection rate (paper, Table I)", columns)
    for dataset in datasets:
        frames = dataset.frames
        if frames is None:
            continue
        bare = {number: list[NDArray[np.float64]]() for number in NUMBERS}
        ours = {number: list[NDArray[np.float64]]() for number in NUMBERS}
        for item in (frames.read(index) for index in range(frames.count)):
            depth, camera = item.frame.depth_metres(), item.frame.intrinsics
            for number in NUMBERS:
                boxes, heat = proposals_and_heat(item.frame, with_proposals(settings, max_boxes=number))
                found = find_in_frame(item.frame.colour, depth, heat.heat, camera, settings.fusion)
                bare[number].append(iou_matrix_2d(item.boxes, boxes))
                ours[number].append(iou_matrix_2d(item.boxes, found.boxes))
        for number in NUMBERS:
            b, o = bare[number], ours[number]
            rates = (success_rate(b), detection_rate(b), success_rate(o), detection_rate(o))
            table.add(dataset.name, number, *rates, _mean_columns(o), _mean_rows(o))
            table.curves += [
                recall_of(dataset.name, f"{number} boxes", b),
                recall_of(dataset.name, f"{number} ours", o),
            ]
    table.notes.append("Boxes: the proposals as they come; ours: what is found with them in the same frame.")
    return table


def filters_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Shares of proposals that the depth filters accept whole, mask in part, reject (paper, Sec. V-A)."""
    columns: tuple[Column, ...] = (Column("data"), Column("metric culling"), Column("proposals a frame", 0))
    columns += (Column("accepted %", 1), Column("masked in part %", 1), Column("rejected %", 1))
    table = Table("filters", "What the depth filters do with the proposals (paper, Sec. V-A)", columns)
    for dataset in datasets:
        for culling in (True, False):
            counts, frames = Counter[str](), 0
            for frame in _all_frames(dataset):
                _, heat = proposals_and_heat(frame, with_proposals(settings, metric_culling=culling))
                counts.update(accepted=heat.accepted, masked=heat.masked, rejected=heat.rejected)
                frames += 1
            total = counts.total()
            shares = (100 * counts[name] / total if total else None for name in ("accepted", "masked", "rejected"))
            table.add(dataset.name, "on" if culling else "off", total / max(1, frames), *shares)
    table.notes.append(
        "Metric culling skips most windows of impossible size before they become proposals; the paper has none."
    )
    return table


def proposals_and_heat(frame: RgbdFrame, settings: Settings) -> tuple[NDArray[np.float32], Heat]:
    """The first two stages on one frame: (M, 5) boxes, and the heat of what the filters leave of them."""
    depth, camera = frame.depth_metres(), frame.intrinsics
    boxes = propose(frame.colour, depth, camera, settings.proposals)
    return boxes, weighted_heat(depth, camera, boxes, settings.heatmap)


def with_proposals(settings: Settings, **changes: int | bool) -> Settings:
    """The same settings with these of the proposals stage changed."""
    return settings.model_copy(update={"proposals": settings.proposals.model_copy(update=changes)})


def _all_frames(dataset: DataSet) -> Iterator[RgbdFrame]:
    if dataset.frames is not None:
        yield from (dataset.frames.read(index).frame for index in range(dataset.frames.count))
    else:
        for item in dataset.sequences:
            yield from item.sequence


def _mean_columns(matrices: list[NDArray[np.float64]]) -> float:
    return float(np.mean([matrix.shape[1] for matrix in matrices]))


def _mean_rows(matrices: list[NDArray[np.float64]]) -> float:
    return float(np.mean([matrix.shape[0] for matrix in matrices]))
