"""Whether the segments of a cluster are an object, and what box they have together."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.fusion.objects.balance import TILT, Numbers, Piece
from spot3d.fusion.objects.disputed import without_disputed
from spot3d.fusion.objects.footing import lower_edge
from spot3d.fusion.objects.found import ObjectViews, box_of, ground_below
from spot3d.fusion.objects.reasons import GONE, MOSTLY_BACKGROUND, TOO_LARGE, TOO_SELDOM, TOO_SMALL, TOO_THIN
from spot3d.fusion.objects.segment_graph import SegmentGraph
from spot3d.fusion.objects.views import BACKGROUND, THROUGH, eyes_of
from spot3d.fusion.settings import FusionSettings


@dataclass(frozen=True, slots=True)
class Described:
    """A cluster that is an object, or would be if it were warmer: then its number is 0. piece: how it stands."""

    item: FoundObject
    piece: Piece


class Least(NamedTuple):
    """Least keyframes of an object, and tau of its confidence; both are less while there are few keyframes."""

    views: int
    tau: float


class ClusterJudge:
    """Judges clusters of a graph's segments. least: for the graph's present number of keyframes."""

    def __init__(self, graph: SegmentGraph, settings: FusionSettings) -> None:
        self._graph, self._settings = graph, settings
        count = len(graph.views)
        tau = min(settings.views_tau, settings.tau_share * count) if settings.tau_share else settings.views_tau
        self.least = Least(min(settings.views_min, count), tau)

    def judged(
        self, members: NDArray[np.int64], observations: NDArray[np.int32], up: NDArray[np.float64]
    ) -> Described | str:
        """The object of a cluster's segments, without a number, or why it is none. observations: of the members."""
        settings, segments = self._settings, self._graph.segments
        least, tau = self.least
        if len(members) < least or len(own := np.unique(segments.frame.rows[members])) < least:
            return TOO_SELDOM
        # A view sees a cluster if it sees most of its segments, and as an object if most of these say so.
        frames, frame = np.unique(np.concatenate((own, observations[:, 1])), return_inverse=True)
        seen, through, background = (
            np.bincount(frame[len(own) :], which, len(frames))
            for which in (observations[:, 2] > THROUGH, observations[:, 2] == THROUGH, observations[:, 2] == BACKGROUND)
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
        # A cluster that is too large in its views is no object, even if leaving out disputed points makes it smaller.
        low, high = views.places.min(axis=0).min(axis=0), views.places.max(axis=0).max(axis=0)
        if np.linalg.norm(high - low) > settings.size_max < self._box_of(views, up).size.max():
            return TOO_LARGE
        views = self._undisputed(views, members)
        box = self._box_of(views, up)
        shortest, middle, _ = np.sort(box.size)
        # An object measured as 2 cm wide has a smaller box: its faces are trimmed and drawn in.
        wide = settings.size_min - settings.plane_distance
        if middle < wide or box.volume < settings.volume_min:
            return TOO_SMALL
        # What is thin lies on something. What nothing is seen beneath is a board's edge, or a piece of a wall.
        ground = ground_below(box, segments.support.rows[members], up)  # by all segments, disputed ones too
        if shortest < (wide if np.isnan(ground) else settings.plane_distance):
            return TOO_THIN
        pixels = segments.pixels.rows[members]
        colour = np.average(segments.colour.rows[members], axis=0, weights=pixels)
        item = FoundObject(0, box, confidence, len(own), int(pixels.sum()), colour)
        edge = lower_edge(views, box, TILT)
        return Described(item, Piece(box, ground, box if edge is None else edge, leans=edge is not None))

    def box_of_all(self, around: Box3D, pieces: Numbers, whole: NDArray[np.int64], up: NDArray[np.float64]) -> Box3D:
        """The box of an object in pieces, from all of their segments and those (rows) that hold it whole.

        around: the box of all pieces, returned if too few views hold it whole, or if the other is too large.
        """
        segments = self._graph.segments
        if len(np.unique(segments.frame.rows[whole])) < self.least.views:
            return around
        rows = np.union1d(np.flatnonzero(np.isin(segments.cluster.rows, pieces)), whole)
        box = self._box_of(self._undisputed(self._seen(rows), rows), up)
        return box if box.size.max() <= self._settings.size_max else around

    def _undisputed(self, views: ObjectViews, rows: NDArray[np.int64]) -> ObjectViews:
        """What these segments saw of an object, without the points that other views dispute (see `disputed`)."""
        if "disputed" in self._settings.skipped:
            return views
        graph = self._graph
        mine = np.zeros(len(graph.segments) + 1, np.bool_)  # row -1: of no segment
        mine[rows] = True
        own = {number: (graph.views[number], mine[graph.rows_of[number]]) for number in np.unique(views.frame).tolist()}
        places, kept = without_disputed(views.places, views.frame, own)
        return views.with_places(places, kept)

    def _seen(self, rows: NDArray[np.int64]) -> ObjectViews:
        """What these segments saw of an object, in the order of their frames."""
        segments, frame = self._graph.segments, self._graph.segments.frame.rows[rows]
        outline = segments.outline.rows[rows]
        return ObjectViews(
            segments.places.rows[rows],
            outline if "outline" not in self._settings.skipped else np.full_like(outline, np.nan),
            segments.blur.rows[rows],
            segments.support.rows[rows],
            frame,
            eyes_of(self._graph.views[number] for number in frame.tolist()),
        )

    def _box_of(self, views: ObjectViews, up: NDArray[np.float64]) -> Box3D:
        return box_of(views, up, self._settings.plane_distance, "rounded" not in self._settings.skipped)
