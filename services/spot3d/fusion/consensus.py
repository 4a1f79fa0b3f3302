"""The objects that the keyframes' views agree on, kept from update to update (see `views` and `agreement`)."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.boxes import Box3D
from spot3d.camera import back_project
from spot3d.fusion.agreement import clusters_of
from spot3d.fusion.found import Seen, box_of
from spot3d.fusion.identity import FoundObject
from spot3d.fusion.keyframes import Keyframe
from spot3d.fusion.reasons import MOSTLY_BACKGROUND, TOO_COLD, TOO_LARGE, TOO_SELDOM, TOO_SMALL, TOO_THIN
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.views import BACKGROUND, DIVIDED, NOTHING, OBJECT, SAMPLE, WHOLE, View, ask, view_of
from spot3d.geometry.planes import transform_plane

_PIXELS = 20
"""A segment of fewer pixels of the lattice has no shape."""
_AROUND = 4
"""What a segment stands on is looked at this far around it, pixels, and a quarter of its length more."""
_BENT = 0.02
"""As far from its plane may a support be there, metres: what depth sensors bend it by, and no step to another."""
_LEVEL = 0.985
"""Supports whose normals are within 10 degrees have the same up."""
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


@dataclass(slots=True, eq=False)
class _Segments:
    """Rows of all segments. frame: (n,) number of each one's keyframe; label: (n,) in it; places: (n, SAMPLE, 3)
    float32 world; heat: (n,); colour: (n, 3) mean RGB; pixels: (n,); support: (n, 4) plane, world, zeros = none;
    identity: (n,) number of the object that it belonged to last, 0 = none; cluster: (n,), -1 = none."""

    frame: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    label: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    places: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, SAMPLE, 3), np.float32))
    heat: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    colour: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    pixels: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    support: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    identity: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    cluster: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.frame)

    def joined(self, other: "_Segments") -> "_Segments":
        """These rows and, after them, those of another."""
        return _Segments(*(np.concatenate((getattr(self, n), getattr(other, n))) for n in self.__slots__))

    def only(self, rows: NDArray[np.bool_]) -> "_Segments":
        """These rows alone."""
        return _Segments(*(getattr(self, name)[rows] for name in self.__slots__))


class ViewConsensus:
    """Takes in keyframes, and lets their segments vote which of them are one object.

    An update looks at the keyframes that came since the last one, and again at those clusters only that they see.
    dropped: how many keyframes went because there were more than `keyframe_limit`, the oldest first, and with them
    the objects that no other keyframe shows.
    """

    def __init__(self, settings: FusionSettings) -> None:
        self.dropped = 0
        self._settings = settings
        self._waiting: list[Keyframe] = []
        self._views: dict[int, View] = {}
        self._normals: dict[int, NDArray[np.float64]] = {}
        self._segments = _Segments()
        # Rows of segments and what other keyframes say of them: (k, 4) segment, keyframe, what, row of the segment
        # that holds it or -1.
        self._said = np.zeros((0, 4), np.int64)
        self._found: dict[int, tuple[FoundObject | None, str]] = {}
        self._next_keyframe = 0
        self._next_cluster = 0
        self._next_identity = 1

    def __len__(self) -> int:
        return len(self._views) + len(self._waiting)

    def add(self, keyframe: Keyframe) -> None:
        """Take in one keyframe, the latest one; it is looked at with the next update."""
        self._waiting.append(keyframe)

    def take_waiting(self) -> list[Keyframe]:
        """The keyframes that came since the last update, which are that update's to take in."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def update(self, keyframes: list[Keyframe]) -> Consensus:
        """Take in keyframes, in their order, and find the objects. Updates run one at a time."""
        touched = np.zeros(len(self._segments), np.bool_)
        for keyframe in keyframes:
            touched = self._take_in(keyframe, touched)
        if len(self._views) > self._settings.keyframe_limit:
            touched = self._drop_oldest(touched)
        up = self._up()
        if touched.any():
            self._cluster(touched)
            self._describe(touched, up)
        objects = [found for found, _ in self._found.values() if found is not None]
        left_out = Counter(reason for _, reason in self._found.values() if reason)
        return Consensus(sorted(objects, key=lambda item: item.id), up, left_out, self.dropped)

    def _take_in(self, keyframe: Keyframe, touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Ask the new view about the segments that there are, and the views that there are about the new segments."""
        view, number = view_of(keyframe), self._next_keyframe
        self._next_keyframe += 1
        old, new = self._segments, _segments_of(keyframe, number)
        row_of = np.full(256, -1)
        row_of[new.label] = len(old) + np.arange(len(new))
        said, label = np.empty(len(old), np.uint8), np.empty(len(old), np.uint8)
        ask(view, old.places, said, label)
        rows = np.flatnonzero(said != NOTHING)
        parts = [np.column_stack((rows, np.full(len(rows), number), said[rows], row_of[label[rows]]))]
        said, label = np.empty(len(new), np.uint8), np.empty(len(new), np.uint8)
        holders = {frame: np.full(256, -1) for frame in self._views}
        for row, (frame, name) in enumerate(zip(old.frame.tolist(), old.label.tolist(), strict=True)):
            holders[frame][name] = row
        for other, earlier in self._views.items() if len(new) else ():
            ask(earlier, new.places, said, label)
            rows = np.flatnonzero(said != NOTHING)
            held = holders[other][label[rows]]
            parts.append(np.column_stack((len(old) + rows, np.full(len(rows), other), said[rows], held)))
        added = np.concatenate(parts)
        self._said = np.concatenate((self._said, added))
        self._views[number] = view
        if len(keyframe.planes):
            self._normals[number] = keyframe.T_world_camera[:3, :3] @ keyframe.planes[0, :3]
        self._segments = old.joined(new)
        touched = np.concatenate((touched, np.ones(len(new), np.bool_)))
        touched[added[:, 0]] = True
        return touched

    def _drop_oldest(self, touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Forget keyframes that are too many, with their segments and all that was said of and by them."""
        excess = len(self._views) - self._settings.keyframe_limit
        gone = list(self._views)[: excess + int(_DROPPED_SHARE * self._settings.keyframe_limit)]
        for number in gone:
            del self._views[number]
            self._normals.pop(number, None)
        self.dropped += len(gone)
        kept = ~np.isin(self._segments.frame, gone)
        touched |= np.isin(self._segments.cluster, np.unique(self._segments.cluster[~kept]))
        new_row = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
        said = self._said[kept[self._said[:, 0]] & ~np.isin(self._said[:, 1], gone)]
        said[:, 0], said[:, 3] = new_row[said[:, 0]], new_row[said[:, 3]]
        self._said, self._segments = said, self._segments.only(kept)
        return touched[kept]

    def _up(self) -> NDArray[np.float64]:
        """The direction that most keyframes' supporting planes have for their normal."""
        normals = np.array(list(self._normals.values())).reshape(-1, 3)
        if not len(normals):
            return np.array([0.0, 0.0, 1.0])
        some = normals[:: max(1, len(normals) // 200)]
        alike = some @ some.T > _LEVEL
        mean = some[alike[np.argmax(alike.sum(axis=1))]].mean(axis=0)
        return np.asarray(mean / np.linalg.norm(mean))

    def _cluster(self, touched: NDArray[np.bool_]) -> None:
        """Cluster anew what hangs together with touched segments; mark all of that as touched."""
        segments, said = self._segments, self._said
        held = said[:, 3] >= 0
        links = csr_array((np.ones(int(held.sum())), (said[held, 0], said[held, 3])), (len(segments), len(segments)))
        _, part = connected_components(links, directed=False)
        touched |= np.isin(part, np.unique(part[touched]))
        rows = np.flatnonzero(touched)
        local = np.full(len(segments) + 1, -1)
        local[rows] = np.arange(len(rows))
        about = said[touched[said[:, 0]]]
        _, frame = np.unique(np.concatenate((segments.frame[rows], about[:, 1])), return_inverse=True)
        own, by = frame[: len(rows)], frame[len(rows) :]
        row, holder = local[about[:, 0]], local[about[:, 3]]
        observed, whole = about[:, 2] >= OBJECT, (about[:, 2] == WHOLE) & (holder >= 0)
        found = clusters_of(
            own,
            np.column_stack((row, by))[observed],
            np.column_stack((row, holder))[whole],
            row[about[:, 2] == DIVIDED],
        )
        for gone in np.unique(segments.cluster[rows]).tolist():
            self._found.pop(gone, None)
        segments.cluster[rows] = np.where(found >= 0, found + self._next_cluster, -1)
        self._next_cluster += int(found.max(initial=-1)) + 1

    def _describe(self, touched: NDArray[np.bool_], up: NDArray[np.float64]) -> None:
        """Describe the touched clusters anew: as objects, or why they are none."""
        segments = self._segments
        rows = np.flatnonzero(touched & (segments.cluster >= 0))
        rows = rows[np.argsort(segments.cluster[rows], kind="stable")]
        clusters, starts = np.unique(segments.cluster[rows], return_index=True)
        groups = np.split(rows, starts[1:]) if len(rows) else []
        about = self._said[np.argsort(self._said[:, 0], kind="stable")]
        ends = np.searchsorted(about[:, 0], np.arange(len(segments) + 1))
        taken: set[int] = {item.id for item, _ in self._found.values() if item is not None}
        described = []
        for cluster, members in zip(clusters.tolist(), groups, strict=True):
            said = np.concatenate([about[ends[row] : ends[row + 1]] for row in members.tolist()])
            described.append((cluster, members, *self._judged(members, said, up)))
        # The largest keeps the number that most of its segments had.
        for cluster, members, box, confidence, reason in sorted(described, key=lambda item: (-len(item[1]), item[0])):
            if box is None or reason:
                self._found[cluster] = (None, reason)
                continue
            identity = self._identity(segments.identity[members], taken)
            segments.identity[members] = identity
            colour = np.average(segments.colour[members], axis=0, weights=segments.pixels[members])
            views = len(np.unique(segments.frame[members]))
            points = int(segments.pixels[members].sum())
            self._found[cluster] = (FoundObject(identity, box, confidence, views, points, colour), "")

    def _identity(self, before: NDArray[np.int64], taken: set[int]) -> int:
        numbers, counts = np.unique(before[before > 0], return_counts=True)
        for number in numbers[np.argsort(-counts, kind="stable")].tolist():
            if number not in taken:
                taken.add(number)
                return int(number)
        self._next_identity += 1
        taken.add(self._next_identity - 1)
        return self._next_identity - 1

    def _judged(
        self, members: NDArray[np.int64], said: NDArray[np.int64], up: NDArray[np.float64]
    ) -> tuple[Box3D | None, float, str]:
        """The box of a cluster's segments, its confidence, and why it is no object, if so. said: of the members."""
        settings, segments = self._settings, self._segments
        own = np.unique(segments.frame[members])
        if len(own) < min(settings.views_min, len(self._views)):
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
        confidence = float(segments.heat[members].sum() / (max(len(members), sees.sum()) + settings.views_tau))
        if confidence < settings.heat_min:
            return None, confidence, TOO_COLD
        views = Seen(segments.places[members], segments.support[members], segments.frame[members])
        box = box_of(views, up, settings.plane_distance)
        shortest, middle, longest = np.sort(box.size)
        if longest > settings.size_max:
            return box, confidence, TOO_LARGE
        if middle < settings.size_min or box.volume < settings.volume_min:
            return box, confidence, TOO_SMALL
        return box, confidence, TOO_THIN if shortest < settings.plane_distance else ""


def _segments_of(keyframe: Keyframe, number: int) -> _Segments:
    """The segments of a keyframe that have depth, each as SAMPLE of its points, evenly spread over its pixels."""
    T, flat = keyframe.T_world_camera, keyframe.labels.ravel()
    grid = back_project(keyframe.depth, keyframe.camera)
    places = grid.reshape(-1, 3)
    valid = np.flatnonzero((flat > 0) & (places[:, 2] > 0))
    order = valid[np.argsort(flat[valid], kind="stable")]
    labels, starts = np.unique(flat[order], return_index=True)
    found = _Segments()
    parts = []
    for label, pixels in zip(labels.tolist(), np.split(order, starts[1:]) if len(order) else [], strict=True):
        if len(pixels) < _PIXELS:
            continue
        chosen = places[pixels[np.linspace(0, len(pixels) - 1, SAMPLE).astype(np.int64)]]
        plane = keyframe.stands_on[label - 1]
        support = transform_plane(_ground(keyframe, pixels, grid, plane), T) if plane >= 0 else np.zeros(4)
        parts.append(
            _Segments(
                np.array([number]),
                np.array([label]),
                (chosen @ T[:3, :3].T + T[:3, 3]).astype(np.float32)[None],
                np.array([float(keyframe.heat[label - 1])]),
                keyframe.colour.reshape(-1, 3)[pixels].mean(axis=0)[None],
                np.array([len(pixels)]),
                support[None],
                np.zeros(1, np.int64),
                np.full(1, -1),
            )
        )
    for part in parts:
        found = found.joined(part)
    return found


def _ground(
    keyframe: Keyframe, pixels: NDArray[np.int64], grid: NDArray[np.float32], plane: int
) -> NDArray[np.float64]:
    """The plane that a segment stands on, shifted to what is seen of it around the segment: depth bends planes.

    pixels: flat numbers of the segment's; grid: (h, w, 3) float32 points. Camera frame.
    """
    support: NDArray[np.float64] = keyframe.planes[plane]
    v, u = np.divmod(pixels, grid.shape[1])
    reach = _AROUND + int(max(np.ptp(v), np.ptp(u)) / 4)
    rows = slice(max(0, v.min() - reach), v.max() + reach + 1)
    columns = slice(max(0, u.min() - reach), u.max() + reach + 1)
    height = grid[rows, columns] @ support[:3].astype(np.float32) + np.float32(support[3])
    bare = (keyframe.labels[rows, columns] == 0) & (grid[rows, columns, 2] > 0) & (np.abs(height) < _BENT)
    if np.count_nonzero(bare) < _PIXELS:
        return support
    return np.append(support[:3], support[3] - float(np.median(height[bare])))
