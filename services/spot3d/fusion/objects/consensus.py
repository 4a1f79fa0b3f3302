"""The objects that the keyframes' views agree on, kept from update to update (see `views` and `agreement`)."""

from collections import Counter, deque
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.frame_segments import KEYFRAME_REASONS
from spot3d.fusion.objects.agreement import clusters_of
from spot3d.fusion.objects.disputed import without_disputed
from spot3d.fusion.objects.found import Seen, box_of
from spot3d.fusion.objects.growing import Growing
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.reasons import MOSTLY_BACKGROUND, TOO_COLD, TOO_LARGE, TOO_SELDOM, TOO_SMALL, TOO_THIN
from spot3d.fusion.objects.rescaling import camera_of, rescale_segments, rescaled_view
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import BACKGROUND, DIVIDED, NOTHING, OBJECT, WHOLE, View, ask, view_of
from spot3d.fusion.settings import FusionSettings

_LEVEL = 0.985
"""Supports whose normals are within 10 degrees have the same up."""
_TURNED = np.cos(np.deg2rad(0.5))
"""Boxes that were made with another up are made anew: half a degree moves the corner of a mug by a millimetre."""
_SAME_PLACE, _SAME_TURN, _SAME_VIEWS = 0.05, np.deg2rad(3.0), 5
"""Of keyframes so near to each other, metres and radians, the last five are kept: at a range of 1 m, 5 cm to the side
show a thing from 3 degrees further round. A still camera must not crowd out all else."""
_HOT = 0.5
"""The hottest object of a scene is mostly hotter than this: of redkitchen 0.6, of built-in scenes 0.6 to 0.8."""
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
        self._in_keyframes: Counter[str] = Counter()  # what the segments stage left out of keyframes, by reason
        self._taken: deque[Keyframe] = deque()
        self._views: dict[int, View] = {}
        self._factor_of: dict[int, float] = {}  # what the depth of each view has been multiplied by
        self._rows_of: dict[int, NDArray[np.int32]] = {}  # the segment of each label of a view, (256,), -1 = none
        self._reaches = Growing[np.float32](np.float32, 4)  # centre and reach of each view
        self._normals: dict[int, NDArray[np.float64]] = {}
        self._segments = SegmentTable()
        # What other keyframes say of segments: row of the segment, keyframe, what, row of the segment that holds it.
        self._said = Growing[np.int32](np.int32, 4)
        self._linked = 0  # of that so many rows are in the segments' `part`
        self._found: dict[int, tuple[FoundObject | None, str]] = {}
        self._described_up = np.zeros(3)
        self._hottest = 0.0
        self._next_keyframe = 0
        self._next_cluster = 0
        self._next_identity = 1

    def __len__(self) -> int:
        return len(self._views) + len(self._taken) + len(self._waiting)

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

    def update(self, keyframes: list[Keyframe], depth_factor: float = 1.0) -> Consensus:
        """Take in keyframes, in their order, and find the objects. Updates run one at a time.

        depth_factor: what all their depth is to be multiplied by, as far as is known by now.
        Where one cannot be taken in, that is raised, and those after it are the next update's.
        """
        segments = self._segments
        self._taken.extend(keyframes)
        while self._taken:
            # With fewer keyframes than an object needs, the rule for it changes with each.
            if len(self._views) < self._settings.views_min:
                segments.touched.rows[:] = True
            self._take_in(self._taken.popleft())
            outdated = self._outdated()
            excess = len(self._views) - len(outdated) - self._settings.keyframe_limit
            if excess > 0:
                several = excess + int(_DROPPED_SHARE * self._settings.keyframe_limit)
                outdated = sorted({*outdated, *list(self._views)[:several]})
                self._dropped += several
            if outdated:
                self._drop(outdated)
        self._rescale(depth_factor)
        up = self._up()
        if up @ self._described_up < _TURNED:
            segments.touched.rows[:] = True
            self._described_up = up
        if segments.touched.rows.any():
            self._hang_together()
            self._describe(self._cluster(), up)
            segments.touched.rows[:] = False
        objects = [found for found, _ in self._found.values() if found is not None]
        left_out = Counter(reason for _, reason in self._found.values() if reason) + self._in_keyframes
        return Consensus(sorted(objects, key=lambda item: item.id), up, left_out, self.dropped)

    def _take_in(self, keyframe: Keyframe) -> None:
        """Ask the new view about the segments that there are, and the views that there are about the new segments."""
        view, number, segments = view_of(keyframe), self._next_keyframe, self._segments
        old = len(segments)
        row_of = segments.extend(keyframe, number)
        self._next_keyframe += 1
        # Whoever finds segments may have reasons of their own, but not ever new ones.
        self._in_keyframes.update({k: n for k, n in keyframe.left_out.items() if k in KEYFRAME_REASONS})
        count = len(segments) - old
        said, label = np.empty((2, max(old, count)), np.uint8)
        places, spheres = segments.places.rows, segments.spheres.rows
        ask(view, places[:old], spheres[:old], said[:old], label[:old])
        self._enter(0, number, said[:old], row_of[label[:old]])
        for other in self._views_of(spheres[old:]):
            ask(self._views[other], places[old:], spheres[old:], said[:count], label[:count])
            self._enter(old, other, said[:count], self._rows_of[other][label[:count]])
        self._views[number], self._rows_of[number] = view, row_of
        self._factor_of[number] = keyframe.depth_factor
        self._reaches.extend(np.append(view.centre, np.float32(view.reach))[None])
        if len(keyframe.planes):
            self._normals[number] = keyframe.T_map_camera[:3, :3] @ keyframe.planes[0, :3]

    def _views_of(self, spheres: NDArray[np.float32]) -> list[int]:
        """The keyframes within whose reach one of these spheres, (k, 4), lies."""
        reaches = self._reaches.rows
        away = np.linalg.norm(reaches[:, None, :3] - spheres[None, :, :3], axis=2)
        near = (away <= reaches[:, None, 3] + spheres[None, :, 3]).any(axis=1)
        return [number for number, is_near in zip(self._views, near.tolist(), strict=True) if is_near]

    def _enter(self, first: int, keyframe: int, said: NDArray[np.uint8], holder: NDArray[np.int32]) -> None:
        """Keep what a keyframe says of the segments from row `first` on."""
        rows = np.flatnonzero(said != NOTHING)
        whole = np.where(said[rows] == WHOLE, holder[rows], -1)
        self._said.extend(np.column_stack((first + rows, np.full(len(rows), keyframe), said[rows], whole)))
        self._segments.touched.rows[first + rows] = True

    def _outdated(self) -> list[int]:
        """The keyframe that the latest one takes the place of: the oldest where there are enough of the same view."""
        numbers = np.fromiter(self._views, np.int64, len(self._views))
        poses = np.stack([view.pose for view in self._views.values()]).astype(np.float64)
        places = -np.einsum("kij,ki->kj", poses[:, :, :3], poses[:, :, 3])
        turned = np.einsum("kij,ij->k", poses[:, :, :3], poses[-1, :, :3])
        same = np.linalg.norm(places - places[-1], axis=1) < _SAME_PLACE
        same &= turned > 1 + 2 * np.cos(_SAME_TURN)
        return [int(number) for number in numbers[same][:-_SAME_VIEWS]]

    def _drop(self, gone: list[int]) -> None:
        """Forget keyframes, with their segments and all that was said of and by them."""
        segments, said = self._segments, self._said.rows
        numbers = np.fromiter(self._views, np.int64, len(self._views))
        for number in gone:
            del self._views[number], self._rows_of[number], self._factor_of[number]
            self._normals.pop(number, None)
        self._reaches.keep(~np.isin(numbers, gone))
        kept = ~np.isin(segments.frame.rows, gone)
        lost = np.unique(segments.cluster.rows[~kept])
        lost = lost[lost >= 0]
        by_gone = np.isin(said[:, 1], gone)
        segments.touched.rows[said[by_gone, 0]] = True
        segments.touched.rows[np.isin(segments.cluster.rows, lost)] = True
        row_now = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
        self._said.keep(~by_gone & kept[said[:, 0]])
        segments.keep(kept)
        said = self._said.rows
        said[:, 0], said[:, 3] = row_now[said[:, 0]], row_now[said[:, 3]]
        for rows in self._rows_of.values():
            rows[:] = row_now[rows]
        # What hung together by what is gone may not any more. A cluster of which nothing is left is no more.
        segments.part.rows[:] = np.arange(len(segments))
        self._linked = 0
        for cluster in np.setdiff1d(lost, segments.cluster.rows).tolist():
            self._found.pop(cluster, None)

    def _rescale(self, depth_factor: float) -> None:
        """See all keyframes by this factor of depth, and ask them anew."""
        segments = self._segments
        wrong = {number: depth_factor / factor for number, factor in self._factor_of.items() if factor != depth_factor}
        if not wrong:
            return
        for number, factor in wrong.items():
            view = self._views[number]
            rescale_segments(segments, np.flatnonzero(segments.frame.rows == number), camera_of(view), factor)
            self._views[number], self._factor_of[number] = rescaled_view(view, factor), depth_factor
        views = self._views.values()
        self._reaches.rows[:] = [(*view.centre, view.reach) for view in views]
        self._said.keep(np.zeros(len(self._said), np.bool_))
        segments.part.rows[:] = np.arange(len(segments))
        self._linked = 0
        said, label = np.empty((2, len(segments)), np.uint8)
        for number, view in self._views.items():
            ask(view, segments.places.rows, segments.spheres.rows, said, label)
            said[segments.frame.rows == number] = NOTHING
            self._enter(0, number, said, self._rows_of[number][label])
        segments.touched.rows[:] = True

    def _up(self) -> NDArray[np.float64]:
        """The direction that most keyframes' supporting planes have for their normal."""
        normals = list(self._normals.values())
        if not normals:
            return np.array([0.0, 0.0, 1.0])
        some = np.array(normals[:: max(1, len(normals) // 200)])
        alike = some @ some.T > _LEVEL
        mean = some[alike[np.argmax(alike.sum(axis=1))]].mean(axis=0)
        return np.asarray(mean / np.linalg.norm(mean))

    def _hang_together(self) -> None:
        """Enter the links that came since the last time into the segments' `part`."""
        part = self._segments.part.rows
        links = self._said.rows[self._linked :]
        links = links[links[:, 3] >= 0]
        parts, ends = np.unique(part[np.concatenate((links[:, 0], links[:, 3]))], return_inverse=True)
        matrix = csr_array((np.ones(len(links)), (ends[: len(links)], ends[len(links) :])), (len(parts), len(parts)))
        _, group = connected_components(matrix, directed=False)
        _, lowest = np.unique(group, return_index=True)
        first = np.arange(len(part))
        first[parts] = parts[lowest[group]]
        part[:] = first[part]
        self._linked = len(self._said)

    def _cluster(self) -> int:
        """Cluster anew what hangs together with what is touched; clusters from the returned number on have changed."""
        segments, said = self._segments, self._said.rows
        part, touched = segments.part.rows, segments.touched.rows
        anew = np.zeros(len(segments), np.bool_)
        anew[part[touched]] = True
        anew = anew[part]
        rows = np.flatnonzero(anew)
        local = np.full(len(segments) + 1, -1)
        local[rows] = np.arange(len(rows))
        about = said[anew[said[:, 0]]]
        _, frame = np.unique(np.concatenate((segments.frame.rows[rows], about[:, 1])), return_inverse=True)
        own, by = frame[: len(rows)], frame[len(rows) :]
        row, holder = local[about[:, 0]], local[about[:, 3]]
        observed, whole = about[:, 2] >= OBJECT, holder >= 0
        found = clusters_of(
            own,
            np.column_stack((row, by))[observed],
            np.column_stack((row, holder))[whole],
            row[about[:, 2] == DIVIDED],
        )
        before = segments.cluster.rows[rows]
        number, changed = _numbered(found, before, touched[rows], self._next_cluster)
        for gone in np.setdiff1d(before, number).tolist():
            self._found.pop(gone, None)
        segments.cluster.rows[rows] = number
        self._next_cluster += changed
        return self._next_cluster - changed

    def _describe(self, first: int, up: NDArray[np.float64]) -> None:
        """Describe the clusters from this number on: as objects, or why they are none."""
        segments, said = self._segments, self._said.rows
        cluster = segments.cluster.rows
        members_of = _grouped(cluster, first, self._next_cluster)
        said_of = _grouped(cluster[said[:, 0]], first, self._next_cluster)
        objects = []
        for number, (members, about) in enumerate(zip(members_of, said_of, strict=True), start=first):
            box, confidence, reason = self._judged(members, said[about], up)
            if box is None or reason:
                self._found[number] = (None, reason)
            else:
                objects.append((number, members, box, confidence))
        cold = self._cold(max((confidence for *_, confidence in objects), default=0.0))
        self._found |= {number: (None, TOO_COLD) for number, *_, confidence in objects if confidence < cold}
        objects = [item for item in objects if item[3] >= cold]
        objects.sort(key=lambda item: (-len(item[1]), item[0]))
        identities = self._identities([members for _, members, _, _ in objects])
        for (number, members, box, confidence), identity in zip(objects, identities, strict=True):
            before = segments.identity.rows[members]
            other = (before > 0) & (before != identity)
            segments.former.rows[members[other]] = before[other]
            segments.identity.rows[members] = identity
            colour = np.average(segments.colour.rows[members], axis=0, weights=segments.pixels.rows[members])
            views = len(np.unique(segments.frame.rows[members]))
            points = int(segments.pixels.rows[members].sum())
            self._found[number] = (FoundObject(identity, box, confidence, views, points, colour), "")

    def _cold(self, hottest: float) -> float:
        """The confidence from which something is an object, eps; what was found before and is colder goes.

        A frame's heat is a share of its maximum, which wanders: where even the hottest object of all is colder than
        `_HOT`, eps falls in proportion.
        """
        self._hottest = max(self._hottest, hottest)
        cold = self._settings.heat_min * min(1.0, self._hottest / _HOT)
        for number, (item, _) in self._found.items():
            if item is not None and item.confidence < cold:
                self._found[number] = (None, TOO_COLD)
        return cold

    def _identities(self, objects: list[NDArray[np.int64]]) -> list[int]:
        """The numbers of objects, each given by its segments: what most of these had last, or before that, or a new.

        Where several want the same number, the earlier in the list gets it.
        """
        taken = {item.id for item, _ in self._found.values() if item is not None}
        given = [0] * len(objects)
        for column in (self._segments.identity.rows, self._segments.former.rows):
            for row, members in enumerate(objects):
                numbers, counts = np.unique(column[members], return_counts=True)
                for number in numbers[np.argsort(-counts, kind="stable")].tolist() if given[row] == 0 else ():
                    if number > 0 and number not in taken:
                        given[row] = number
                        taken.add(number)
                        break
        for row, number in enumerate(given):
            if number == 0:
                given[row] = self._next_identity
                self._next_identity += 1
        return given

    def _judged(
        self, members: NDArray[np.int64], said: NDArray[np.int32], up: NDArray[np.float64]
    ) -> tuple[Box3D | None, float, str]:
        """The box of a cluster's segments, its confidence, and why it is no object, if so. said: of the members."""
        settings, segments = self._settings, self._segments
        least = min(settings.views_min, len(self._views))
        if len(members) < least or len(own := np.unique(segments.frame.rows[members])) < least:
            return None, 0.0, TOO_SELDOM
        # A view sees a cluster where it sees half of its segments, and an object where most of these say so.
        frames, frame = np.unique(np.concatenate((own, said[:, 1])), return_inverse=True)
        seen = np.bincount(frame[len(own) :], minlength=len(frames))
        background = np.bincount(frame[len(own) :], said[:, 2] == BACKGROUND, len(frames))
        mine = np.isin(frames, own)
        sees = mine | (2 * seen > len(members))
        agrees = mine | (sees & (2 * background < seen))
        if agrees.sum() < settings.object_share * sees.sum():
            return None, 0.0, MOSTLY_BACKGROUND
        # The pseudo-average of Eq. 14, over views.
        confidence = float(segments.heat.rows[members].sum() / (max(len(members), sees.sum()) + settings.views_tau))
        views = Seen(segments.places.rows[members], segments.support.rows[members], segments.frame.rows[members])
        # What is too large as its views have it is not made an object by leaving out what they disagree on.
        low, high = views.places.min(axis=0).min(axis=0), views.places.max(axis=0).max(axis=0)
        if float(np.linalg.norm(high - low)) > settings.size_max:
            whole = box_of(views, up, settings.plane_distance)
            if whole.size.max() > settings.size_max:
                return whole, confidence, TOO_LARGE
        box = box_of(self._undisputed(views, segments.cluster.rows[members[0]]), up, settings.plane_distance)
        shortest, middle, _ = np.sort(box.size)
        if middle < settings.size_min or box.volume < settings.volume_min:
            return box, confidence, TOO_SMALL
        return box, confidence, TOO_THIN if shortest < settings.plane_distance else ""

    def _undisputed(self, views: Seen, cluster: np.int64) -> Seen:
        """What was seen of a cluster, without what most of the other views that see the cluster have elsewhere."""
        cluster_of = np.append(self._segments.cluster.rows, -1)  # row -1: of no segment
        own = {
            number: (self._views[number], cluster_of[self._rows_of[number]] == cluster)
            for number in np.unique(views.frame).tolist()
        }
        places, kept = without_disputed(views.places, views.frame, own)
        return Seen(places[kept], views.support[kept], views.frame[kept])


def _numbered(
    found: NDArray[np.int64], before: NDArray[np.int64], touched: NDArray[np.bool_], first: int
) -> tuple[NDArray[np.int64], int]:
    """The number of each segment's cluster, (n,), and how many clusters are new; new numbers count up from `first`.

    found: (n,) clusters from 0 on, -1 = none; before: (n,) the numbers that the segments had. A cluster of the same
    segments as before, none of which is touched, keeps its number.
    """
    inside, count = found >= 0, int(found.max(initial=-1)) + 1
    low, high = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(low, found[inside], before[inside])
    np.maximum.at(high, found[inside], before[inside])
    old, old_sizes = np.unique(before, return_counts=True)
    same_size = old_sizes[np.searchsorted(old, low)] == np.bincount(found[inside], minlength=count)
    hit = np.bincount(found[inside], touched[inside], count) > 0
    new = hit | (low != high) | (low < 0) | ~same_size
    number = np.where(new, first + np.cumsum(new) - 1, low)
    return np.append(number, -1)[found], int(new.sum())


def _grouped(group: NDArray[np.int64], first: int, end: int) -> list[NDArray[np.int64]]:
    """The rows of each group from `first` to before `end`, in their order."""
    rows = np.flatnonzero(group >= first)
    rows = rows[np.argsort(group[rows], kind="stable")]
    return np.split(rows, np.searchsorted(group[rows], np.arange(first + 1, end))) if end > first else []
