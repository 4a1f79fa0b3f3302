"""What keyframes saw, had their depth been longer or shorter and their camera been turned: both are known better as a
run goes on."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.objects.segment_table import SegmentTable
from spot3d.fusion.objects.views import View
from spot3d.trajectory import rotation_from_vector


@dataclass(frozen=True, slots=True)
class Change:
    """How what one camera saw moves: depth times `factor`, and a turn about the camera.

    camera: (3,) where it is, and rotation: (3, 3) how it turns, in the views' world; turn: (3, 3) the same rotation in
    the camera's axes.
    """

    factor: float
    camera: NDArray[np.float64]
    rotation: NDArray[np.float64]
    turn: NDArray[np.float64]

    @classmethod
    def of(cls, view: View, factor: float, before: NDArray[np.float64], now: NDArray[np.float64]) -> Self:
        """Of a view whose camera was turned by the rotation vector `before` (3,) of its axes, and is to be by `now`."""
        axes, origin = np.split(view.pose.astype(np.float64), [3], axis=1)
        turn = rotation_from_vector(before).T @ rotation_from_vector(now)
        # The inverse, not the transpose: what single precision lacks of a rotation must not add up over many changes.
        inverse = np.linalg.inv(axes)
        return cls(factor, -(inverse @ origin)[:, 0], inverse @ turn @ axes, turn)

    def moved(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """Where (..., 3) points come to lie."""
        return self.camera + self.factor * (points - self.camera) @ self.rotation.T


def changed_view(view: View, change: Change) -> View:
    """The view after the change."""
    millimetres = np.rint(view.depth * change.factor)
    depth = np.where(millimetres < 65536, millimetres, 0).astype(np.uint16)
    pose = (change.turn.T @ view.pose).astype(np.float32)
    centre = change.moved(view.centre).astype(np.float32)
    return replace(view, depth=depth, pose=pose, centre=centre, reach=view.reach * change.factor)


def change_segments(segments: SegmentTable, rows: NDArray[np.int64], change: Change) -> None:
    """Put segments of the one keyframe that changes where it then has them."""
    spheres, support = segments.spheres.rows, segments.support.rows
    for points in (segments.places.rows, segments.outline.rows):
        points[rows] = change.moved(points[rows])
    spheres[rows, :3] = change.moved(spheres[rows, :3])
    spheres[rows, 3] *= change.factor
    segments.blur.rows[rows] = segments.blur.rows[rows] @ change.rotation.T
    # Zeros, of a segment that stands on nothing, stay zeros.
    away = change.factor * (support[rows, :3] @ change.camera + support[rows, 3])
    support[rows, :3] = support[rows, :3] @ change.rotation.T
    support[rows, 3] = away - support[rows, :3] @ change.camera
