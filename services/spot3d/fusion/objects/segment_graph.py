"""The graph of the keyframes' segments: the views, and what each says of the others' segments."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spot3d.calibration import Calibration, moved_planes
from spot3d.fusion.objects.agreement import Statements
from spot3d.fusion.objects.growing import Growing
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.recalibration import Change, Placement, change_segments, changed_view
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import BACKGROUND, DIVIDED, NOTHING, OBJECT, WHOLE, View, ask, eyes_of, view_of
from spot3d.pose_corrections import PoseCorrections

_LEVEL = 0.985
"""Supports whose normals are within 10 degrees have the same up."""
_SAME_PLACE, _SAME_TURN, _SAME_VIEWS = 0.05, np.deg2rad(3.0), 5
"""Of keyframes as near to each other as this, metres and radians, the last five are kept: at a range of 1 m, 5 cm to
the side show an object from 3 degrees further round. A still camera must not crowd out all else."""


class SegmentGraph:
    """Segments of keyframes, and for each the keyframes that see it, whether as a whole, and within which segment.

    segments: a row each; observations: (m, 4) int32, each of one segment by another keyframe: row of the segment,
    keyframe, answer (see `views`), row of the segment that holds the whole of it, or -1; views: by the keyframe's
    number, oldest first; rows_of: the segment's row for each label of a view, (256,), -1 = none.
    """

    def __init__(self) -> None:
        self.segments = SegmentTable()
        self.views: dict[int, View] = {}
        self.rows_of: dict[int, NDArray[np.int32]] = {}
        self._observations = Growing[np.int32](np.int32, 4)
        self._linked = 0  # rows of `observations` that are in the segments' `component` already
        self._placed: dict[int, Placement] = {}  # calibration and pose correction of each view
        self._normals: dict[int, NDArray[np.float64]] = {}
        self._next_keyframe = 0

    @property
    def observations(self) -> NDArray[np.int32]:
        return self._observations.rows

    def take_in(self, keyframe: Keyframe, range_max: float = np.inf) -> int:
        """Ask the new view about the present segments, and the present views about the new segments.

        range_max: see `view_of`. Returns how many of its segments have too little depth to be entered.
        """
        view, number, segments = view_of(keyframe, range_max), self._next_keyframe, self.segments
        old = len(segments)
        row_of = segments.extend(keyframe, number)
        self._next_keyframe += 1
        count = len(segments) - old
        places, spheres = segments.places.rows, segments.spheres.rows
        others = self._views_of(spheres[old:])
        self.views[number], self.rows_of[number] = view, row_of
        self._placed[number] = Placement(keyframe.stamp_ns, keyframe.calibration)
        self._ask(number, np.arange(old), places[:old], spheres[:old])
        for other in others:
            self._ask(other, np.arange(old, old + count), places[old:], spheres[old:])
        if len(keyframe.planes):
            self._normals[number] = keyframe.T_map_camera[:3, :3] @ keyframe.planes[0, :3]
        shown = np.bincount(keyframe.labels.ravel(), minlength=256)[1:] > 0
        return int(np.count_nonzero(shown)) - count

    def _views_of(self, spheres: NDArray[np.float32]) -> list[int]:
        """The keyframes whose reach one of these spheres, (k, 4), touches."""
        centres = np.array([view.centre for view in self.views.values()]).reshape(-1, 1, 3)
        reaches = np.array([view.reach for view in self.views.values()], np.float32)[:, None]
        near = (np.linalg.norm(centres - spheres[:, :3], axis=2) <= reaches + spheres[:, 3]).any(axis=1)
        return [number for number, is_near in zip(self.views, near.tolist(), strict=True) if is_near]

    def _ask(
        self, keyframe: int, asked: NDArray[np.int64], places: NDArray[np.float32], spheres: NDArray[np.float32]
    ) -> None:
        """Ask a keyframe about the segments in these rows, but for its own, and record the answers."""
        answers, labels = np.empty((2, len(asked)), np.uint8)
        ask(self.views[keyframe], places, spheres, answers, labels)
        some = np.flatnonzero((answers != NOTHING) & (self.segments.frame.rows[asked] != keyframe))
        asked, answers, holder = asked[some], answers[some], self.rows_of[keyframe][labels[some]]
        whole = np.where(answers == WHOLE, holder, -1)
        self._observations.extend(np.column_stack((asked, np.full(len(some), keyframe), answers, whole)))
        self.segments.touched.rows[asked] = True

    def statements(self, rows: NDArray[np.int64]) -> Statements:
        """What the views say of these segments, and of the segments among these that hold them."""
        segments, local = self.segments, np.full(len(self.segments) + 1, -1)  # row -1: of no segment
        local[rows] = np.arange(len(rows))
        observations = self.observations[local[self.observations[:, 0]] >= 0]
        frames, frame = np.unique(np.concatenate((segments.frame.rows[rows], observations[:, 1])), return_inverse=True)
        own, by = frame[: len(rows)], frame[len(rows) :]
        row, holder = local[observations[:, 0]], local[observations[:, 3]]
        observed, whole = observations[:, 2] >= OBJECT, holder >= 0
        return Statements(
            own,
            np.column_stack((row, by))[observed],
            np.column_stack((row, holder))[whole],
            row[observations[:, 2] == DIVIDED],
            row[observations[:, 2] == BACKGROUND],
            segments.spheres.rows[rows, :3].astype(np.float64),
            eyes_of(self.views[number] for number in frames.tolist()),
        )

    def outdated(self) -> list[int]:
        """The keyframes that the latest one replaces: those of nearly the same view, but for the last five."""
        numbers = np.fromiter(self.views, np.int64, len(self.views))
        poses = np.stack([view.pose for view in self.views.values()]).astype(np.float64)
        places = eyes_of(self.views.values())
        turned = np.einsum("kij,ij->k", poses[:, :, :3], poses[-1, :, :3])
        same = np.linalg.norm(places - places[-1], axis=1) < _SAME_PLACE
        same &= turned > 1 + 2 * np.cos(_SAME_TURN)
        return [int(number) for number in numbers[same][:-_SAME_VIEWS]]

    def drop(self, gone: list[int]) -> list[int]:
        """Forget keyframes, their segments and all observations of and by them; returns clusters that are gone."""
        segments, observations = self.segments, self._observations.rows
        for number in gone:
            del self.views[number], self.rows_of[number], self._placed[number]
            self._normals.pop(number, None)
        kept = ~np.isin(segments.frame.rows, gone)
        lost = np.unique(segments.cluster.rows[~kept])
        lost = lost[lost >= 0]
        by_gone = np.isin(observations[:, 1], gone)
        segments.touched.rows[observations[by_gone, 0]] = True
        segments.touched.rows[np.isin(segments.cluster.rows, lost)] = True
        row_now = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
        self._observations.keep(~by_gone & kept[observations[:, 0]])
        segments.keep(kept)
        observations = self._observations.rows
        observations[:, 0], observations[:, 3] = row_now[observations[:, 0]], row_now[observations[:, 3]]
        for rows in self.rows_of.values():
            rows[:] = row_now[rows]
        self._rebuild_components()  # what the dropped rows linked may be linked no more
        none_left: list[int] = np.setdiff1d(lost, segments.cluster.rows).tolist()
        return none_left

    def see_anew(self, calibration: Calibration, corrections: PoseCorrections | None = None) -> None:
        """Apply this calibration, and these corrections of poses, to the keyframes.

        Those that change are asked anew about all segments, and all others about theirs.
        """
        segments, views = self.segments, self.views
        by_now = {number: placed.by_now(calibration, corrections) for number, placed in self._placed.items()}
        anew = [number for number, placed in by_now.items() if placed != self._placed[number]]
        if not anew:
            return
        for number in anew:
            view = views[number]
            change = Change.of(view, self._placed[number], by_now[number])
            change_segments(segments, np.flatnonzero(segments.frame.rows == number), change)
            views[number] = changed_view(view, change)
            if number in self._normals:
                plane = np.append(self._normals[number], 0.0)[None]
                self._normals[number] = moved_planes(plane, change.linear, change.camera)[0, :3]
        self._placed = by_now
        self._ask_anew(anew)

    def _ask_anew(self, moved: list[int]) -> None:
        """Ask these keyframes about all segments, and all others about their segments."""
        segments, observations = self.segments, self._observations.rows
        has_moved = np.isin(segments.frame.rows, moved)
        outdated = has_moved[observations[:, 0]] | np.isin(observations[:, 1], moved)
        segments.touched.rows[observations[outdated, 0]] = True
        self._observations.keep(~outdated)
        self._rebuild_components()
        every, theirs = np.arange(len(segments)), np.flatnonzero(has_moved)
        segments.touched.rows[theirs] = True
        places, spheres = segments.places.rows, segments.spheres.rows
        of_all, of_theirs = (every, places, spheres), (theirs, places[theirs], spheres[theirs])
        near = set(self._views_of(spheres[theirs])).union(moved)
        for number in [number for number in self.views if number in near]:
            self._ask(number, *(of_all if number in moved else of_theirs))

    def up(self) -> NDArray[np.float64]:
        """The common normal of most keyframes' main supporting planes."""
        normals = list(self._normals.values())
        if not normals:
            return np.array([0.0, 0.0, 1.0])
        some = np.array(normals[:: max(1, len(normals) // 200)])
        alike = some @ some.T > _LEVEL
        mean = some[alike[np.argmax(alike.sum(axis=1))]].mean(axis=0)
        return np.asarray(mean / np.linalg.norm(mean))

    def _rebuild_components(self) -> None:
        """Enter all links again; a cluster stays connected until it is clustered anew, whatever links it lost."""
        component, cluster = np.arange(len(self.segments)), self.segments.cluster.rows
        clustered = np.flatnonzero(cluster >= 0)
        _, first, number = np.unique(cluster[clustered], return_index=True, return_inverse=True)
        component[clustered] = clustered[first][number]
        self.segments.component.rows[:] = component
        self._linked = 0

    def merge_components(self) -> None:
        """Enter the links since the last call into `component`, the segments' connected components."""
        component = self.segments.component.rows
        links = self._observations.rows[self._linked :]
        links = links[links[:, 3] >= 0]
        parts, ends = np.unique(component[np.concatenate((links[:, 0], links[:, 3]))], return_inverse=True)
        matrix = csr_array((np.ones(len(links)), (ends[: len(links)], ends[len(links) :])), (len(parts), len(parts)))
        _, group = connected_components(matrix, directed=False)
        _, lowest = np.unique(group, return_index=True)
        first = np.arange(len(component))
        first[parts] = parts[lowest[group]]
        component[:] = first[component]
        self._linked = len(self._observations)
