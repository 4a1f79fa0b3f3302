"""The objects that the keyframes' views agree on, kept from update to update (see `views` and `agreement`)."""

from collections import Counter, deque
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.calibration import AS_TOLD, Calibration
from spot3d.found_object import FoundObject
from spot3d.frame_segments import KEYFRAME_REASONS, OTHER, SEVERAL, WITHOUT_DEPTH
from spot3d.fusion.objects.agreement import clusters_of
from spot3d.fusion.objects.balance import TILT, Numbers, Piece, put_together
from spot3d.fusion.objects.disputed import without_disputed
from spot3d.fusion.objects.footing import lower_edge, narrow_foot
from spot3d.fusion.objects.found import Seen, box_of, ground_below
from spot3d.fusion.objects.gone import gone_segments
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.numbering import number_clusters, number_objects
from spot3d.fusion.objects.reasons import GONE, MOSTLY_BACKGROUND, TOO_COLD, TOO_LARGE, TOO_SELDOM, TOO_SMALL, TOO_THIN
from spot3d.fusion.objects.segment_graph import SegmentGraph
from spot3d.fusion.objects.views import BACKGROUND, THROUGH
from spot3d.fusion.objects.whole_views import wholes
from spot3d.fusion.settings import FusionSettings
from spot3d.pose_corrections import PoseCorrections

_TURNED = np.cos(np.deg2rad(0.5))
"""Boxes that were made with another up are made anew: half a degree moves the corner of a mug by a millimetre."""
_HOT = 0.5
"""The hottest object of a scene is mostly hotter than this: of redkitchen 0.6, of built-in scenes 0.6 to 0.8."""
_SPREAD = 0.1
"""Standard deviation of an object's heat from view to view: 0.10 to 0.16 on each data set. With it 0.93 of HOTS'
objects are detected that one view sees through all stages, without it 0.89, with a tenth of a box more a frame that is
of none. Where many views see them it is the same on all labelled data, every thirtieth frame or all; redkitchen has 25
boxes for 21: a newspaper on a stand and a leaflet more, a part of a screen on the wall, and one of a pillar.
"""
_DROPPED_SHARE = 0.1
"""Where there are too many keyframes, so many go at once."""


@dataclass(frozen=True, slots=True)
class Consensus:
    """What the views agree on.

    objects: numbered; up: (3,) unit, world; left_out: candidates by reason (see `reasons`); dropped: keyframes that
    went because there were too many.
    """

    objects: list[FoundObject]
    up: NDArray[np.float64]
    left_out: Counter[str]
    dropped: int


class ViewConsensus:
    """Takes in keyframes, and lets their segments vote which of them are one object.

    An update looks at the keyframes that came since the last one, clusters anew what hangs together with what they
    see, and describes anew those clusters of which something has changed.
    """

    def __init__(self, settings: FusionSettings) -> None:
        self._settings = settings
        self._waiting: deque[Keyframe] = deque()
        self._skipped = 0
        # Of the updates alone from here on: they may run in a thread of their own.
        self._dropped = 0
        self._in_keyframes: Counter[str] = Counter()  # what was left out of single keyframes, by reason
        self._taken: deque[Keyframe] = deque()
        self._graph = SegmentGraph()
        # Of each cluster the object that it is, and how that stands, or why it is none; what is too cold has no number.
        self._verdicts: dict[int, tuple[FoundObject, Piece] | str] = {}
        self._described_up = np.zeros(3)
        self._hottest = 0.0
        self._some_gone = False  # since objects were compared with the hottest one
        self._next_cluster = 0
        self._next_identity = 1

    def __len__(self) -> int:
        return len(self._graph.views) + len(self._taken) + len(self._waiting)

    @property
    def dropped(self) -> int:
        """How many keyframes went because there were more than `keyframe_limit`, the oldest first.

        The objects that no other keyframe shows went with them. Those whose place later ones took are not counted.
        """
        return self._dropped + self._skipped

    def add(self, keyframe: Keyframe) -> None:
        """Take in one keyframe, the latest one; it is looked at with the next update."""
        self._waiting.append(keyframe)
        if len(self._waiting) > self._settings.keyframe_limit:
            self._waiting.popleft()
            self._skipped += 1

    def without_waiting(self) -> "ViewConsensus":
        """The same without the keyframes that came since the last update: it shares everything else with this one."""
        shared = copy(self)
        shared._waiting = deque()
        return shared

    def take_waiting(self) -> list[Keyframe]:
        """The keyframes that came since the last update, which are that update's to take in."""
        waiting, self._waiting = self._waiting, deque()
        return list(waiting)

    def update(
        self,
        keyframes: list[Keyframe],
        calibration: Calibration = AS_TOLD,
        corrections: PoseCorrections | None = None,
    ) -> Consensus:
        """Take in keyframes, in their order, and find the objects. Updates run one at a time.

        calibration: by which they all are to be seen, as far as is known by now; corrections: of their poses, in the
        axes of the map of poses.
        Where one cannot be taken in, that is raised, and those after it are the next update's.
        """
        graph = self._graph
        self._taken.extend(keyframes)
        while self._taken:
            self._take_in(self._taken.popleft())
        graph.see_anew(calibration, corrections)
        up = graph.up()
        # Before the first keyframe nothing is known to be up, and nothing described.
        if graph.views and up @ self._described_up < _TURNED:
            graph.segments.touched.rows[:] = True
            self._described_up = up
        touched = bool(graph.segments.touched.rows.any())
        if touched:
            graph.hang_together()
        if touched or self._some_gone:
            gone = self._gone()
            self._describe(self._cluster(gone) if touched else self._next_cluster, up, gone)
            graph.segments.touched.rows[:] = False
            self._some_gone = False
        objects, too_cold = self._whole_objects(up)
        left_out = Counter(reason for reason in self._verdicts.values() if isinstance(reason, str)) + self._in_keyframes
        several = int(np.count_nonzero(graph.segments.cluster.rows < 0))
        left_out += Counter({TOO_COLD: too_cold, SEVERAL: several})
        return Consensus(sorted(objects, key=lambda item: item.id), up, left_out, self.dropped)

    def _take_in(self, keyframe: Keyframe) -> None:
        graph, limit = self._graph, self._settings.keyframe_limit
        rules = self._rules()
        self._in_keyframes[WITHOUT_DEPTH] += graph.take_in(keyframe, self._settings.range_max)
        for reason, count in keyframe.left_out.items():
            # Whoever finds segments may have reasons of their own, but not ever new ones.
            self._in_keyframes[reason if reason in KEYFRAME_REASONS else OTHER] += count
        outdated = graph.outdated()
        excess = len(graph.views) - len(outdated) - limit
        if excess > 0:
            several = excess + int(_DROPPED_SHARE * limit)
            outdated = sorted({*outdated, *list(graph.views)[:several]})
            self._dropped += several
        for cluster in graph.drop(outdated) if outdated else ():
            self._verdicts.pop(cluster, None)
            self._some_gone = True
        if self._rules() != rules:
            graph.segments.touched.rows[:] = True

    def _rules(self) -> tuple[int, float]:
        """The least number of an object's keyframes, and tau of its confidence: both are less while there are few."""
        settings, count = self._settings, len(self._graph.views)
        tau = min(settings.views_tau, settings.tau_share * count) if settings.tau_share else settings.views_tau
        return min(settings.views_min, count), tau

    def _gone(self) -> NDArray[np.bool_]:
        """Which segments show what is not there any more."""
        if "gone" in self._settings.skipped:
            return np.zeros(len(self._graph.segments), np.bool_)
        return gone_segments(self._graph.said, self._graph.segments.frame.rows)

    def _cluster(self, gone: NDArray[np.bool_]) -> int:
        """Cluster anew what hangs together with what is touched; clusters from the returned number on have changed.

        What is gone is not joined with what has taken its place.
        """
        graph, settings = self._graph, self._settings
        segments = graph.segments
        part, touched = segments.part.rows, segments.touched.rows
        anew = np.zeros(len(segments), np.bool_)
        anew[part[touched]] = True
        rows = np.flatnonzero(anew[part])
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
        segments, said = self._graph.segments, self._graph.said
        cluster = segments.cluster.rows
        members_of = _grouped(cluster, first, self._next_cluster)
        said_of = _grouped(cluster[said[:, 0]], first, self._next_cluster)
        objects = []
        for number, (members, about) in enumerate(zip(members_of, said_of, strict=True), start=first):
            judged = self._judged(members, said[about], up)
            if gone[members].all() and not isinstance(judged, str):
                judged = GONE
            if isinstance(judged, str):
                self._verdicts[number] = judged
            else:
                objects.append((number, members, len(np.unique(segments.frame.rows[members])), *judged))
        objects += self._compared(max((confidence for *_, confidence in objects), default=0.0))
        warm = [item for item in objects if not self._is_cold(confidence=item[4], views=item[2])]
        warm.sort(key=lambda item: (-len(item[1]), item[0]))
        taken = {found[0].id for found in self._verdicts.values() if not isinstance(found, str)}
        columns = segments.identity.rows, segments.former.rows
        identities = number_objects([item[1] for item in warm], columns, taken, self._next_identity)
        self._next_identity = max((self._next_identity, *(number + 1 for number in identities)))
        for (_, members, *_), identity in zip(warm, identities, strict=True):
            before = segments.identity.rows[members]
            other = (before > 0) & (before != identity)
            segments.former.rows[members[other]] = before[other]
            segments.identity.rows[members] = identity
        numbers = {item[0]: identity for item, identity in zip(warm, identities, strict=True)}
        for number, members, views, piece, confidence in objects:
            colour = np.average(segments.colour.rows[members], axis=0, weights=segments.pixels.rows[members])
            points = int(segments.pixels.rows[members].sum())
            item = FoundObject(numbers.get(number, 0), piece.box, confidence, views, points, colour)
            self._verdicts[number] = item, piece

    def _is_cold(self, confidence: float, views: int) -> bool:
        """Whether an object's heat is below eps, by more than the mean of so many views may be by chance.

        A frame's heat is a share of its maximum, which wanders: where even the hottest object of all is colder than
        `_HOT`, eps falls in proportion.
        """
        cold = self._settings.heat_min * min(1.0, self._hottest / _HOT)
        return bool(confidence + _SPREAD / np.sqrt(views) < cold)

    def _compared(self, hottest: float) -> list[tuple[int, NDArray[np.int64], int, Piece, float]]:
        """Compare what was found before with the hottest object that there is by now: what is cold beside it loses its
        number. What was cold and is not any more is returned, to be numbered: as `_describe` has objects.

        hottest: confidence of the hottest of those that are described now.
        """
        known = [(number, *found) for number, found in self._verdicts.items() if not isinstance(found, str)]
        self._hottest = max((hottest, *(item.confidence for _, item, _ in known)))
        warmer = []
        for number, item, piece in known:
            cold = self._is_cold(item.confidence, item.views)
            if cold:
                self._verdicts[number] = replace(item, id=0), piece
            elif not item.id:
                members = np.flatnonzero(self._graph.segments.cluster.rows == number)
                warmer.append((number, members, item.views, piece, item.confidence))
        return warmer

    def _whole_objects(self, up: NDArray[np.float64]) -> tuple[list[FoundObject], int]:
        """The objects, with what cannot stand by itself put together with what it stands on.

        And how many clusters are too cold, and not a part of these.
        """
        found = {number: found for number, found in self._verdicts.items() if not isinstance(found, str)}
        hot = {number for number, (item, _) in found.items() if item.id}
        if "balance" in self._settings.skipped:
            return [found[number][0] for number in hot], len(found) - len(hot)
        things = put_together({number: piece for number, (_, piece) in found.items()}, hot, up, self._settings.size_max)
        whole = wholes(things, self._graph.said, self._graph.segments.cluster.rows)
        boxes = things | {pieces: self._box_of_all(things[pieces], pieces, rows, up) for pieces, rows in whole.items()}
        objects = [_one_of([found[piece][0] for piece in pieces], box) for pieces, box in boxes.items()]
        return objects, len(found) - sum(map(len, boxes))

    def _box_of_all(self, around: Box3D, pieces: Numbers, whole: NDArray[np.int64], up: NDArray[np.float64]) -> Box3D:
        """The box of a thing in pieces, by all of their segments and by those (rows) that have it whole.

        around: of all pieces; that is the box where hardly a view has them whole, or some see more than an object.
        """
        segments = self._graph.segments
        if len(np.unique(segments.frame.rows[whole])) < self._rules()[0]:
            return around
        rows = np.union1d(np.flatnonzero(np.isin(segments.cluster.rows, pieces)), whole)
        box = self._box_of(self._undisputed(self._seen(rows), rows), up)
        return box if box.size.max() <= self._settings.size_max else around

    def _box_of(self, views: Seen, up: NDArray[np.float64]) -> Box3D:
        return box_of(views, up, self._settings.plane_distance, "rounded" not in self._settings.skipped)

    def _seen(self, rows: NDArray[np.int64]) -> Seen:
        """What was seen of something by these segments, in the order of their frames."""
        segments, frame = self._graph.segments, self._graph.segments.frame.rows[rows]
        outline = segments.outline.rows[rows]
        poses = np.array([self._graph.views[number].pose for number in frame.tolist()], np.float64)
        return Seen(
            segments.places.rows[rows],
            outline if "outline" not in self._settings.skipped else np.full_like(outline, np.nan),
            segments.blur.rows[rows],
            segments.support.rows[rows],
            frame,
            -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3]),
        )

    def _judged(
        self, members: NDArray[np.int64], said: NDArray[np.int32], up: NDArray[np.float64]
    ) -> tuple[Piece, float] | str:
        """The box of a cluster's segments and its confidence, or why it is no object. said: of the members."""
        settings, segments = self._settings, self._graph.segments
        least, tau = self._rules()
        if len(members) < least or len(own := np.unique(segments.frame.rows[members])) < least:
            return TOO_SELDOM
        # A view sees a cluster where it sees half of its segments, and an object where most of these say so.
        frames, frame = np.unique(np.concatenate((own, said[:, 1])), return_inverse=True)
        seen, through, background = (
            np.bincount(frame[len(own) :], which, len(frames))
            for which in (said[:, 2] > THROUGH, said[:, 2] == THROUGH, said[:, 2] == BACKGROUND)
        )
        mine = np.isin(frames, own)
        sees = mine | (2 * seen > len(members))
        looks_through = ~sees & (2 * through > len(members))
        latest = looks_through[sees | looks_through][-least:]
        if latest.all() and "gone" not in settings.skipped:
            return GONE
        agrees = mine | (sees & (2 * background < seen))
        if agrees.sum() < settings.object_share * sees.sum():
            return MOSTLY_BACKGROUND
        # The pseudo-average of Eq. 15, over views.
        confidence = float(segments.heat.rows[members].sum() / (max(len(members), sees.sum()) + tau))
        views = self._seen(members)
        # What is too large as its views have it is not made an object by leaving out what they disagree on.
        low, high = views.places.min(axis=0).min(axis=0), views.places.max(axis=0).max(axis=0)
        if np.linalg.norm(high - low) > settings.size_max < self._box_of(views, up).size.max():
            return TOO_LARGE
        views = self._undisputed(views, members)
        box = self._box_of(views, up)
        shortest, middle, _ = np.sort(box.size)
        # A thing that is measured 2 cm across has a box that is less: its faces are trimmed and drawn in.
        if middle < settings.size_min - settings.plane_distance or box.volume < settings.volume_min:
            return TOO_SMALL
        if shortest < settings.plane_distance:
            return TOO_THIN
        return self._piece(views, box, segments.support.rows[members], up), confidence

    def _piece(self, views: Seen, box: Box3D, support: NDArray[np.float64], up: NDArray[np.float64]) -> Piece:
        """How something stands. support: of all of its segments, with what is disputed."""
        ground = ground_below(box, support, up)
        edge = lower_edge(views, box, TILT)
        if edge is not None:
            return Piece(box, ground, edge, leans=True)
        foot = None
        # A foot that is narrower than the least thing is not told from noise.
        if TILT * box.size[2] > self._settings.size_min:
            foot = narrow_foot(views, box, TILT)
        return Piece(box, ground, box if foot is None else foot, leans=False)

    def _undisputed(self, views: Seen, rows: NDArray[np.int64]) -> Seen:
        """What these segments saw of something, without what most of the other views that see it have elsewhere."""
        if "disputed" in self._settings.skipped:
            return views
        graph = self._graph
        mine = np.zeros(len(graph.segments) + 1, np.bool_)  # row -1: of no segment
        mine[rows] = True
        own = {number: (graph.views[number], mine[graph.rows_of[number]]) for number in np.unique(views.frame).tolist()}
        places, kept = without_disputed(views.places, views.frame, own)
        return views.with_places(places, kept)


def _one_of(parts: list[FoundObject], box: Box3D) -> FoundObject:
    """The object that these are together: it has the number of the first one found, and the heat of the hottest."""
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
