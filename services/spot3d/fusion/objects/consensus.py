"""The objects that the keyframes' views agree on, kept from update to update (see `views` and `agreement`)."""

from collections import Counter, deque
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.calibration import NOMINAL, Calibration
from spot3d.found_object import FoundObject, FoundObjects
from spot3d.frame_segments import KEYFRAME_REASONS, OTHER, SEVERAL, WITHOUT_DEPTH
from spot3d.fusion.objects.agreement import clusters_of
from spot3d.fusion.objects.balance import put_together
from spot3d.fusion.objects.cluster_judge import ClusterJudge, Described
from spot3d.fusion.objects.gone import gone_segments
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.numbering import number_clusters, number_objects
from spot3d.fusion.objects.reasons import GONE, TOO_COLD, TOO_SELDOM
from spot3d.fusion.objects.segment_graph import SegmentGraph
from spot3d.fusion.objects.whole_views import wholes
from spot3d.fusion.settings import FusionSettings
from spot3d.pose_corrections import PoseCorrections
from spot3d_schemas.limits import MAX_COUNT

_TURNED = np.cos(np.deg2rad(0.5))
"""Boxes computed with another up are computed again: half a degree moves the corner of a mug by a millimetre."""
_SPREAD = 0.1
"""Standard deviation of an object's heat from view to view: 0.10 to 0.16 on each data set. With it, 0.93 of HOTS'
objects that one view sees are detected through all stages, without it 0.89, at the cost of a tenth of a box of no
object a frame. With many views, in 31 runs, it gains 0.009 in detection, and costs 0.02 in success and half a box of no
object a scene. Redkitchen has 25 boxes instead of 21: a newspaper on a stand and a leaflet more, a part of a screen on
the wall, and one of a pillar.
"""
_DROPPED_SHARE = 0.1
"""Share of the limit dropped at once if there are too many keyframes."""


class ViewConsensus:
    """Takes in keyframes, and clusters their segments into objects by the votes of the views.

    An update takes in the keyframes since the last one, clusters anew the connected components of what they see, and
    describes anew the clusters that have changed.
    """

    def __init__(self, settings: FusionSettings) -> None:
        self._settings = settings
        self._waiting: deque[Keyframe] = deque()
        self._skipped = 0
        # Only updates use what follows: they may run in a thread of their own.
        self._dropped = 0
        self._in_keyframes: Counter[str] = Counter()  # what was left out of single keyframes, by reason
        self._taken: deque[Keyframe] = deque()
        self._graph = SegmentGraph()
        self._verdicts: dict[int, Described | str] = {}  # of each cluster the object that it is, or why it is none
        self._described_up = np.zeros(3)
        self._next_cluster = 0
        self._next_identity = 1

    def __len__(self) -> int:
        return len(self._graph.views) + len(self._taken) + len(self._waiting)

    @property
    def dropped(self) -> int:
        """How many keyframes were dropped because there were more than `keyframe_limit`, the oldest first.

        The objects that no other keyframe shows went with them. Keyframes that later ones replaced are not counted.
        """
        return self._dropped + self._skipped

    def add(self, keyframe: Keyframe) -> None:
        """Take in one keyframe, the latest; the next update uses it."""
        self._waiting.append(keyframe)
        if len(self._waiting) > self._settings.keyframe_limit:
            self._waiting.popleft()
            self._skipped += 1

    def without_waiting(self) -> "ViewConsensus":
        """A copy without the keyframes that came since the last update; it shares everything else with this one."""
        shared = copy(self)
        shared._waiting = deque()
        return shared

    def take_waiting(self) -> list[Keyframe]:
        """Remove and return the keyframes that came since the last update, for the next one to take in."""
        waiting, self._waiting = self._waiting, deque()
        return list(waiting)

    def update(
        self,
        keyframes: list[Keyframe],
        calibration: Calibration = NOMINAL,
        corrections: PoseCorrections | None = None,
        lasting: bool = False,
    ) -> FoundObjects:
        """Take in keyframes, in their order, and find the objects. Updates run one at a time.

        calibration: by which all keyframes are seen, as far as known by now; corrections: of their poses, in the axes
        of the map of poses, as is what is found. The frames are not counted here. lasting: an object that no update
        before had waits for the next one, unless there were fewer than `views_min` keyframes before. On redkitchen,
        forwards, backwards, mirrored, rolled, scaled and with KISS-ICP, 125 numbers are given and gone before the end,
        36 of them in one update alone. Waiting for one update more would keep back 12 others, for a third 8.
        If one cannot be taken in, the exception is raised, and those after it are left to the next update.
        """
        graph = self._graph
        first_new = self._next_identity if lasting and len(graph.views) >= self._settings.views_min else MAX_COUNT
        self._taken.extend(keyframes)
        while self._taken:
            self._take_in(self._taken.popleft())
        graph.see_anew(calibration, corrections)
        up = graph.up()
        # Before the first keyframe, up is unknown, and nothing is described.
        if graph.views and up @ self._described_up < _TURNED:
            graph.segments.touched.rows[:] = True
            self._described_up = up
        if graph.segments.touched.rows.any():
            graph.merge_components()
            gone = self._gone()
            self._describe(self._cluster(gone), up, gone)
            graph.segments.touched.rows[:] = False
        objects, too_cold = self._whole_objects(up)
        left_out = Counter(reason for reason in self._verdicts.values() if isinstance(reason, str)) + self._in_keyframes
        several = int(np.count_nonzero(graph.segments.cluster.rows < 0))
        known = [item for item in objects if item.id < first_new]
        left_out += Counter({TOO_COLD: too_cold, SEVERAL: several, TOO_SELDOM: len(objects) - len(known)})
        # A segmenter's counts can be so large that a message cannot state their sum.
        left_out = Counter({reason: min(count, MAX_COUNT) for reason, count in left_out.items()})
        known.sort(key=lambda item: item.id)
        return FoundObjects(known, up, left_out=left_out, keyframes_dropped=self.dropped)

    def _take_in(self, keyframe: Keyframe) -> None:
        graph, limit = self._graph, self._settings.keyframe_limit
        least = self._judge().least
        self._in_keyframes[WITHOUT_DEPTH] += graph.take_in(keyframe, self._settings.range_max)
        for reason, count in keyframe.left_out.items():
            # Segmenters may have reasons of their own, but not an unbounded number of them.
            self._in_keyframes[reason if reason in KEYFRAME_REASONS else OTHER] += count
        outdated = graph.outdated()
        excess = len(graph.views) - len(outdated) - limit
        if excess > 0:
            several = excess + int(_DROPPED_SHARE * limit)
            outdated = sorted({*outdated, *list(graph.views)[:several]})
            self._dropped += several
        for cluster in graph.drop(outdated) if outdated else ():
            self._verdicts.pop(cluster, None)
        if self._judge().least != least:
            graph.segments.touched.rows[:] = True

    def _judge(self) -> ClusterJudge:
        """Judges clusters by the present number of keyframes."""
        return ClusterJudge(self._graph, self._settings)

    def _gone(self) -> NDArray[np.bool_]:
        """Which segments show what is no longer there."""
        if "gone" in self._settings.skipped:
            return np.zeros(len(self._graph.segments), np.bool_)
        return gone_segments(self._graph.observations, self._graph.segments.frame.rows)

    def _cluster(self, gone: NDArray[np.bool_]) -> int:
        """Cluster anew the components with touched segments; clusters from the returned number on have changed.

        What is gone is not joined with what has taken its place.
        """
        graph, settings = self._graph, self._settings
        segments = graph.segments
        component, touched = segments.component.rows, segments.touched.rows
        anew = np.zeros(len(segments), np.bool_)
        anew[component[touched]] = True
        rows = np.flatnonzero(anew[component])
        found = np.full(len(segments), -1)
        for together in (rows[~gone[rows]], rows[gone[rows]]):
            join_parts = "parts" not in settings.skipped
            statements = graph.statements(together)
            clusters = clusters_of(statements, settings.views_min, settings.object_share, join_parts)
            found[together] = np.where(clusters >= 0, 1 + found.max() + clusters, -1)
        before = segments.cluster.rows[rows]
        number, changed = number_clusters(found[rows], before, touched[rows], self._next_cluster)
        for lost in np.setdiff1d(before, number).tolist():
            self._verdicts.pop(lost, None)
        segments.cluster.rows[rows] = number
        self._next_cluster += changed
        return self._next_cluster - changed

    def _describe(self, first: int, up: NDArray[np.float64], gone: NDArray[np.bool_]) -> None:
        """Describe the clusters from this number on: as objects, or why they are none."""
        segments, observations, judge = self._graph.segments, self._graph.observations, self._judge()
        cluster = segments.cluster.rows
        members_of = _grouped(cluster, first, self._next_cluster)
        observations_of = _grouped(cluster[observations[:, 0]], first, self._next_cluster)
        for number, (members, about) in enumerate(zip(members_of, observations_of, strict=True), start=first):
            verdict = judge.judged(members, observations[about], up)
            self._verdicts[number] = GONE if isinstance(verdict, Described) and gone[members].all() else verdict
        self._number_warm()

    def _number_warm(self) -> None:
        """Number the clusters that are warm and have no number yet.

        Cold is a confidence below eps by more than chance explains in a mean over its views.
        """
        segments, described = self._graph.segments, self._described()
        anew = []
        for number, found in described.items():
            warm = found.item.confidence + _SPREAD / np.sqrt(found.item.views) >= self._settings.heat_min
            if warm and not found.item.id:
                anew.append((number, np.flatnonzero(segments.cluster.rows == number)))
        anew.sort(key=lambda one: (-len(one[1]), one[0]))
        taken = {found.item.id for found in described.values()}
        columns = segments.identity.rows, segments.former.rows
        identities = number_objects([members for _, members in anew], columns, taken, self._next_identity)
        self._next_identity = max((self._next_identity, *(identity + 1 for identity in identities)))
        for (number, members), identity in zip(anew, identities, strict=True):
            before = segments.identity.rows[members]
            other = (before > 0) & (before != identity)
            segments.former.rows[members[other]] = before[other]
            segments.identity.rows[members] = identity
            found = described[number]
            self._verdicts[number] = replace(found, item=replace(found.item, id=identity))

    def _described(self) -> dict[int, Described]:
        """The clusters that are objects, or would be if they were warmer."""
        return {number: found for number, found in self._verdicts.items() if not isinstance(found, str)}

    def _whole_objects(self, up: NDArray[np.float64]) -> tuple[list[FoundObject], int]:
        """The objects, joined with what they stand on where they cannot stand by themselves.

        Also returned: how many clusters are too cold, and not a part of an object.
        """
        found, judge = self._described(), self._judge()
        hot = {number for number, each in found.items() if each.item.id}
        if "balance" in self._settings.skipped:
            return [found[number].item for number in hot], len(found) - len(hot)
        pieces = {number: each.piece for number, each in found.items()}
        boxes = put_together(pieces, hot, up, self._settings.size_max)
        for thing, rows in wholes(boxes, self._graph.observations, self._graph.segments.cluster.rows).items():
            boxes[thing] = judge.box_of_all(boxes[thing], thing, rows, up)
        objects = [_one_of([found[number].item for number in thing], box) for thing, box in boxes.items()]
        return objects, len(found) - sum(map(len, boxes))


def _one_of(parts: list[FoundObject], box: Box3D) -> FoundObject:
    """The object that these form together, with the least of their numbers and the highest confidence."""
    if len(parts) == 1:
        return parts[0]
    points = [part.points for part in parts]
    return FoundObject(
        id=min(part.id for part in parts if part.id),
        box=box,
        confidence=max(part.confidence for part in parts),
        views=max(part.views for part in parts),
        points=sum(points),
        colour=np.average([part.colour for part in parts], axis=0, weights=points),
    )


def _grouped(group: NDArray[np.int64], first: int, end: int) -> list[NDArray[np.int64]]:
    """The rows of each group from `first` to before `end`, in their order."""
    rows = np.flatnonzero(group >= first)
    rows = rows[np.argsort(group[rows], kind="stable")]
    return np.split(rows, np.searchsorted(group[rows], np.arange(first + 1, end))) if end > first else []
