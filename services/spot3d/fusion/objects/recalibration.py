"""What keyframes saw, had their camera been calibrated otherwise: it is known better as a run goes on."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration, moved_planes, sheared
from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import View, within_reach
from spot3d.trajectory import rotation_from_vector


@dataclass(frozen=True, slots=True)
class Change:
    """How what one camera saw moves.

    camera: (3,) where it is, and linear: (3, 3) how what it saw moves about it, in the views' world; turn: (3, 3) how
    it turns, in its own axes; factor: of depth; shift: (2,) of the principal point, focal lengths.
    """

    camera: NDArray[np.float64]
    linear: NDArray[np.float64]
    turn: NDArray[np.float64]
    factor: float
    shift: NDArray[np.float64]

    @classmethod
    def of(cls, view: View, before: Calibration, now: Calibration) -> Self:
        """Of a view that was seen by one calibration, and is to be by another."""
        axes, origin = np.split(view.pose.astype(np.float64), [3], axis=1)
        turn = rotation_from_vector(np.array(before.turn)).T @ rotation_from_vector(np.array(now.turn))
        factor = now.depth_factor / before.depth_factor
        x, y = now.centre[0] - before.centre[0], now.centre[1] - before.centre[1]
        # The inverse, not the transpose: what single precision lacks of a rotation must not add up over many changes.
        inverse = np.linalg.inv(axes)
        linear = factor * inverse @ turn @ sheared((x, y)) @ axes
        return cls(-(inverse @ origin)[:, 0], linear, turn, factor, np.array((x, y)))

    @property
    def growth(self) -> float:
        """By how much, at most, two points come to lie further apart."""
        return float(np.linalg.norm(self.linear, 2))

    def moved(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """Where (..., 3) points come to lie."""
        return self.camera + (points - self.camera) @ self.linear.T


def changed_view(view: View, change: Change) -> View:
    """The view after the change."""
    millimetres = np.rint(view.depth * change.factor)
    depth = np.where(millimetres < 65536, millimetres, 0).astype(np.uint16)
    pose = (change.turn.T @ view.pose).astype(np.float32)
    focal = view.focal.copy()
    focal[2:] -= (change.shift * view.focal[:2]).astype(np.float32)
    centre, reach = within_reach(depth, pose, focal)
    return replace(view, depth=depth, pose=pose, focal=focal, centre=centre, reach=reach)


def change_segments(segments: SegmentTable, rows: NDArray[np.int64], change: Change) -> None:
    """Put segments of the one keyframe that changes where it then has them."""
    spheres, blur, support = segments.spheres.rows, segments.blur.rows, segments.support.rows
    for points in (segments.places.rows, segments.outline.rows):
        points[rows] = change.moved(points[rows])
    spheres[rows, :3] = change.moved(spheres[rows, :3])
    spheres[rows, 3] *= change.growth
    blur[rows] = blur[rows] @ change.linear.T
    support[rows] = moved_planes(support[rows], change.linear, change.camera)
