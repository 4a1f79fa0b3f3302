"""Stability of a run's objects: id switches, and jitter of boxes from one update to the next."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import nan
from statistics import median

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, iou_matrix_3d

Update = Sequence[tuple[int, Box3D]]
Match = tuple[int, Box3D] | None


@dataclass(frozen=True, slots=True, eq=False)
class Stability:
    """Stability of each of N true objects over a run.

    id_switches: (N,) int64, how often the matched id changed.
    matched: (N,) float64, the share of updates in which the object is matched; nan without updates.
    centre_jitter: (N,) float64 metres, median move of the matched box's centre from one update to the next.
    size_jitter: (N,) float64 metres, median change of its size.

    Jitter is over the last half of the run, nan if the object is never matched in two consecutive updates.
    """

    id_switches: NDArray[np.int64]
    matched: NDArray[np.float64]
    centre_jitter: NDArray[np.float64]
    size_jitter: NDArray[np.float64]


def stability(updates: Sequence[Update], truth: Sequence[Box3D], threshold: float = 0.25) -> Stability:
    """Count id switches and measure jitter over a run's updates, in order of time.

    updates: each a list of (id, box), world frame. truth: N true boxes. In each update an object is matched by the box
    with the largest IoU, if that is at least `threshold`. As in MOTA, an id is compared with the last one that matched,
    however long ago: losing an object is no switch, finding it again under another id is one.
    """
    matches = [_matches(update, truth, threshold) for update in updates]
    tracks = [[found[row] for found in matches] for row in range(len(truth))]
    jitters = [_jitter(track[len(track) // 2 :]) for track in tracks]
    return Stability(
        id_switches=np.array([_id_switches(track) for track in tracks], dtype=np.int64),
        matched=np.array([_matched_part(track) for track in tracks], dtype=np.float64),
        centre_jitter=np.array([centre for centre, _ in jitters], dtype=np.float64),
        size_jitter=np.array([size for _, size in jitters], dtype=np.float64),
    )


def _matches(update: Update, truth: Sequence[Box3D], threshold: float) -> list[Match]:
    """Each true box's best (id, box) of one update, or None below the threshold."""
    if not update:
        return [None] * len(truth)
    iou = iou_matrix_3d(truth, [box for _, box in update])
    return [update[int(row.argmax())] if row.max() >= threshold else None for row in iou]


def _id_switches(track: Sequence[Match]) -> int:
    ids = [match[0] for match in track if match is not None]
    return sum(before != after for before, after in pairwise(ids))


def _matched_part(track: Sequence[Match]) -> float:
    return sum(match is not None for match in track) / len(track) if track else nan


def _jitter(track: Sequence[Match]) -> tuple[float, float]:
    """Median move of the centre and change of the size, metres, between consecutive updates that both match."""
    moves, changes = [], []
    for before, after in pairwise(track):
        if before is not None and after is not None:
            moves.append(float(np.linalg.norm(after[1].centre - before[1].centre)))
            # Sorted: a box that turns by 90 degrees exchanges its axes but has not changed.
            changes.append(float(np.linalg.norm(np.sort(after[1].size) - np.sort(before[1].size))))
    return (median(moves), median(changes)) if moves else (nan, nan)
