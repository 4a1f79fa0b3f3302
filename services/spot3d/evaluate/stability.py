"""Stability of a run's objects: id switches, and jitter of boxes from one update to the next."""

from collections.abc import Sequence
from itertools import pairwise
from math import nan
from statistics import median
from typing import NamedTuple

import numpy as np

from spot3d.boxes import Box3D, iou_matrix_3d

Update = Sequence[tuple[int, Box3D]]
Match = tuple[int, Box3D] | None


class Stability(NamedTuple):
    """Stability of one true object over a run.

    id_switches: how often the matched id changed; matched: the share of updates in which it is matched, nan without
    updates. centre_jitter, size_jitter: metres, the median move of the matched box's centre and change of its size from
    one update to the next, over the last half of the run; nan if it is never matched in two consecutive updates.
    """

    id_switches: int
    matched: float
    centre_jitter: float
    size_jitter: float


def stability(updates: Sequence[Update], truth: Sequence[Box3D], threshold: float = 0.25) -> list[Stability]:
    """Count id switches and measure jitter of each true box over a run's updates, in order of time.

    updates: each a list of (id, box), world frame. In each update an object is matched by the box with the largest IoU,
    if that is at least `threshold`. As in MOTA, an id is compared with the last one that matched, however long ago:
    losing an object is no switch, finding it again under another id is one.
    """
    matches = [_matches(update, truth, threshold) for update in updates]
    return [_stability([found[row] for found in matches]) for row in range(len(truth))]


def _matches(update: Update, truth: Sequence[Box3D], threshold: float) -> list[Match]:
    """Each true box's best (id, box) of one update, or None below the threshold."""
    if not update:
        return [None] * len(truth)
    iou = iou_matrix_3d(truth, [box for _, box in update])
    return [update[int(row.argmax())] if row.max() >= threshold else None for row in iou]


def _stability(track: Sequence[Match]) -> Stability:
    ids = [match[0] for match in track if match is not None]
    switches = sum(before != after for before, after in pairwise(ids))
    return Stability(switches, len(ids) / len(track) if track else nan, *_jitter(track[len(track) // 2 :]))


def _jitter(track: Sequence[Match]) -> tuple[float, float]:
    """Median move of the centre and change of the size, metres, between consecutive updates that both match."""
    moves, changes = [], []
    for before, after in pairwise(track):
        if before is not None and after is not None:
            moves.append(float(np.linalg.norm(after[1].centre - before[1].centre)))
            # Sorted: a box that turns by 90 degrees exchanges its axes but has not changed.
            changes.append(float(np.linalg.norm(np.sort(after[1].size) - np.sort(before[1].size))))
    return (median(moves), median(changes)) if moves else (nan, nan)
