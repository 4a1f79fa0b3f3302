"""How results of single frames degrade with depth, colour and intrinsics."""

from collections.abc import Callable

import numpy as np

from spot3d.drawing.charts import Curve
from spot3d.evaluate.degraded import Degradation
from spot3d.evaluate.frame_tables import BOTH_METHODS, FoundInFrames, boxes_in_frame, proposals_and_heat
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.object_tables import OURS
from spot3d.evaluate.peer import PEER, peer_in_frame
from spot3d.evaluate.robustness import NOTE_WORSE, groups
from spot3d.evaluate.table import Table, columns
from spot3d.settings import Settings
from spot3d.source.sequence import FrameList

OF_FRAMES = ("centre", "focal", "scale", "bent", "depth", "edges", "holes", "colour")
"""Kinds of degradation that a frame by itself can have."""


def frame_robustness_table(
    datasets: list[DataSet], settings: Settings, every: int, only: tuple[str, ...], say: Callable[[str], None]
) -> Table:
    """Single frames of ours and of the peer with degraded input, with curves over each kind (not in the paper).

    only: which kinds; those that need several frames are left out. A camera's own errors are alike in all frames.
    """
    heads = (*columns("data", "worse"), *BOTH_METHODS)
    table = Table("robustness-frames", "Single frame: success and detection rate with degraded input", heads)
    base = Degradation()
    kinds = {kind: levels for kind, levels in groups(base).items() if kind in only and kind in OF_FRAMES}
    for dataset in datasets:
        items = [read() for read in dataset.readers[::every]]
        frames = FrameList(item.frame for item in items)
        done: dict[Degradation, tuple[FoundInFrames, FoundInFrames]] = {}
        for worse, level in [("nothing", base), *((f"{k}: {n}", one) for k, v in kinds.items() for n, one in v)]:
            if level in done:
                continue
            say(f"{dataset.name}, worse: {worse} ...")
            ours, peer = done[level] = FoundInFrames(), FoundInFrames()
            for item, frame in zip(items, level.of(frames), strict=True):
                _, heat = proposals_and_heat(frame, settings)
                ours.add(item, boxes_in_frame(frame, heat, settings))
                peer.add(item, peer_in_frame(frame.depth_metres(), frame.intrinsics, settings.fusion.size_max))
            table.add(dataset.name, worse, *ours.cells(), *peer.cells(), peer.true)
            table.notes += ours.behind(peer, f"{dataset.name}, worse: {worse}")
        for kind, levels in kinds.items():
            places, names = np.linspace(0, 1, len(levels)), tuple(name for name, _ in levels)
            for method, which in ((OURS, 0), (PEER, 1)):
                detection = np.array([done[level][which].scores.detection for _, level in levels])
                table.curves.append(Curve(f"{dataset.name} {kind}", f"{method} detection", places, detection, names))
    table.notes += [NOTE_WORSE, "Errors that need several frames are left out."]
    return table
