"""Tables of single frames: success and detection over the number of proposals (Table I), worth of steps, filters."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import iou_matrix_2d
from spot3d.evaluate.labelled import DataSet, LabelledFrame, boxes_around
from spot3d.evaluate.peer import PEER, RADIUS, RANGE_MAX, behind_peer, peer_in_frame
from spot3d.evaluate.scores import HIT, ObjectScores, object_scores, recall_of, without_object
from spot3d.evaluate.table import Cell, Column, Table, columns
from spot3d.frame import RgbdFrame
from spot3d.fusion.paper.density_frame import find_by_density_in_frame
from spot3d.heatmap.heat import Heatmap, weighted_heat
from spot3d.proposals.propose import propose
from spot3d.segments.finder import find_segments
from spot3d.segments.settings import Step
from spot3d.settings import Settings

NUMBERS = (50, 100, 500, 1000, 2000)
"""Input proposals of the paper's Table I."""

BOTH_METHODS = (
    *(
        Column(f"{method} {name}", digits)
        for method in ("ours", "peer")
        for name, digits in (("SR", 2), ("DR", 2), ("a frame", 1), ("no object", 1), ("left out", 1))
    ),
    Column("true a frame", 1),
)
"""Columns of ours, of the peer, and of the true objects."""


def proposals_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Success (SR) and detection rate (DR) at IoU 0.5 of the proposals, of ours (paper, Table I), and of the peer.

    Ours: filter the proposals by depth, remove the supporting plane, cluster, and box each cluster's pixels.
    """
    heads = (*columns("data", "proposals", "boxes SR", "boxes DR"), *BOTH_METHODS)
    table = Table("proposals", "Single frame: success and detection rate (paper, Table I)", heads)
    for dataset in datasets:
        bare, ours = ({number: FoundInFrames() for number in NUMBERS} for _ in range(2))
        peer = FoundInFrames()
        for item in dataset.frames:
            depth, camera = item.frame.depth_metres(), item.frame.intrinsics
            peer.add(item, peer_in_frame(depth, camera, settings.fusion.size_max))
            for number in NUMBERS:
                boxes, heat = proposals_and_heat(item.frame, settings.changed("proposals", max_boxes=number))
                bare[number].add(item, boxes)
                ours[number].add(item, boxes_in_frame(item.frame, heat, settings))
        for number in NUMBERS:
            b, o = bare[number], ours[number]
            table.add(dataset.name, number, b.scores.success, b.scores.detection, *o.cells(), *peer.cells(), peer.true)
            table.curves += [
                recall_of(dataset.name, f"{number} boxes", b.iou),
                recall_of(dataset.name, f"{number} ours", o.iou),
            ]
            table.notes += o.behind(peer, f"{dataset.name} with {number} proposals")
        table.curves.append(recall_of(dataset.name, PEER, peer.iou))
    table.notes += [
        "Boxes: the proposals as they come; ours: what is found with them in the same frame. "
        f"Peer: {PEER}, the dominant plane and all beneath it taken away, radius {100 * RADIUS:g} cm, without "
        f"depth beyond {RANGE_MAX:g} m and clusters longer than {settings.fusion.size_max:g} m.",
        "No object: found boxes per frame that overlap every true one by less than IoU 0.25. Left out: boxes per "
        "frame that hit nothing and lie mostly on unlabelled pixels.",
    ]
    return table


@dataclass(slots=True)
class FoundInFrames:
    """A method's results in a data set's frames: IoU matrices (true, counted), and the number of boxes left out."""

    iou: list[NDArray[np.float64]] = field(default_factory=list)
    left_out: int = 0

    def add(self, item: LabelledFrame, boxes: NDArray[np.floating]) -> None:
        iou, left_out = judged_overlap(item, boxes)
        self.iou.append(iou)
        self.left_out += left_out

    @property
    def scores(self) -> ObjectScores:
        return object_scores(self.iou)

    @property
    def true(self) -> float:
        """True objects per frame."""
        return float(np.mean([matrix.shape[0] for matrix in self.iou]))

    def behind(self, peer: "FoundInFrames", where: str) -> list[str]:
        """A sentence on the measures in which the peer is better, if any."""
        a, b = self.scores, peer.scores
        return behind_peer(where, [("success", a.success, b.success), ("detection", a.detection, b.detection)])

    def cells(self) -> tuple[Cell, ...]:
        """Success and detection rate; boxes, boxes without an object and boxes left out, each per frame."""
        found, rates = float(np.mean([matrix.shape[1] for matrix in self.iou])), self.scores
        return rates.success, rates.detection, found, without_object(self.iou), self.left_out / len(self.iou)


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
            table.add(dataset.name, name, success, detection, one.scores.iou, a_frame, no_object, one.true)
    table.notes.append("The steps are those of `segments.skipped`.")
    return table


def filters_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Shares of proposals that the depth filters accept, mask in part, or reject (paper, Sec. VI-A)."""
    heads = (*columns("data", "metric culling"), Column("proposals a frame", 0))
    heads += columns("accepted %", "masked in part %", "rejected %", digits=1)
    table = Table("filters", "What the depth filters do with the proposals (paper, Sec. VI-A)", heads)
    for dataset in datasets:
        for culling in (True, False):
            counts, frames = Counter[str](), 0
            for frame in _all_frames(dataset):
                _, heat = proposals_and_heat(frame, settings.changed("proposals", metric_culling=culling))
                counts.update(accepted=heat.accepted, masked=heat.masked, rejected=heat.rejected)
                frames += 1
            total = counts.total()
            shares = (100 * counts[name] / total if total else None for name in ("accepted", "masked", "rejected"))
            table.add(dataset.name, "on" if culling else "off", total / max(1, frames), *shares)
    table.notes.append(
        "Metric culling skips most windows of implausible size before they become proposals; the paper does not use it."
    )
    return table


def proposals_and_heat(frame: RgbdFrame, settings: Settings) -> tuple[NDArray[np.float32], Heatmap]:
    """The first two stages on one frame: (M, 5) boxes, and the heat of those that the filters keep."""
    depth, camera = frame.depth_metres(), frame.intrinsics
    boxes = propose(frame.colour, depth, camera, settings.proposals)
    return boxes, weighted_heat(depth, camera, boxes, settings.heatmap)


def boxes_in_frame(frame: RgbdFrame, heat: Heatmap, settings: Settings) -> NDArray[np.float64]:
    """(n, 4) [x, y, w, h] boxes of the objects of a single frame, found by the method that fusion uses over time."""
    depth, camera = frame.depth_metres(), frame.intrinsics
    if settings.fusion.clustering == "density":
        parts = find_by_density_in_frame(depth, heat.heat, camera, settings.fusion)
        return boxes_around(np.divmod(part, camera.width) for part in parts)
    return find_segments(frame.colour, depth, heat.heat, camera, settings.segments).boxes(camera)


def _all_frames(dataset: DataSet) -> Iterator[RgbdFrame]:
    if dataset.readers:
        yield from (item.frame for item in dataset.frames)
    else:
        for item in dataset.sequences:
            yield from item.sequence


def judged_overlap(item: LabelledFrame, found: NDArray[np.floating]) -> tuple[NDArray[np.float64], int]:
    """IoU (true, counted) of the found boxes (m, 4 or more) that count, and how many are left out.

    Left out are boxes that hit no true object and have more than half of their pixels where nothing is annotated.
    """
    iou = iou_matrix_2d(item.boxes, found)
    if item.unjudged is None or not len(found):
        return iou, 0
    stray = iou.max(axis=0, initial=0.0) < HIT
    counts = ~(stray & (_share(item.unjudged, found[:, :4].astype(np.float64)) > 0.5))
    return iou[:, counts], int(np.count_nonzero(~counts))


def _share(mask: NDArray[np.bool_], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share (m,) of each box's pixels (m, 4) [x, y, w, h] that are set in an (h, w) mask."""
    sums = np.asarray(cv2.integral(mask.astype(np.uint8)), np.int64)
    height, width = mask.shape
    low = np.clip(np.rint(boxes[:, :2]).astype(np.int64), 0, (width, height))
    high = np.clip(np.rint(boxes[:, :2] + boxes[:, 2:]).astype(np.int64), 0, (width, height))
    (left, top), (right, bottom) = low.T, high.T
    inside = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return np.asarray(inside / np.maximum(1, (right - left) * (bottom - top)))
