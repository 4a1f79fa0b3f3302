"""Keyframes as seen with another calibration or pose of their camera: both become better known as a run goes on."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration, bend_at, bend_of_image, moved_planes, sheared
from spot3d.fusion.objects.segment_table import SegmentTable, spheres_around
from spot3d.fusion.objects.views import FAR, NEAREST, View, within_reach
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_from_vector

_STEP = 0.0005
"""Smaller changes of poses, metres and radians, are ignored: a quarter of a pixel's noise at a metre.

With a whole pixel's noise, views that stay lie apart from views that move: clutter and a desk seen from near, with
poses shaken by 10 mm, have an IoU that is 0.02 less. An update of the objects takes as long.
"""


@dataclass(frozen=True, slots=True)
class Placement:
    """When a keyframe was seen, with which calibration, and the twist (6,) that has corrected its pose since."""

    stamp_ns: int
    calibration: Calibration
    twist: tuple[float, ...] = (0.0,) * 6

    def by_now(self, calibration: Calibration, corrections: PoseCorrections | None) -> Self:
        """The same with all that is known now; corrections: in the axes of the views' world."""
        twist = None if corrections is None else corrections.at(self.stamp_ns)
        if twist is None or np.abs(twist - self.twist).max() < _STEP:
            return replace(self, calibration=calibration)
        return replace(self, calibration=calibration, twist=tuple(twist.tolist()))


@dataclass(frozen=True, slots=True)
class Change:
    """How what one camera saw moves.

    camera: (3,) its place; step: (3,) its move; linear: (3, 3) how what it saw moves about it, in the views' world,
    once it is straightened; axes: (3, 3) the camera's, after the change; factor: of depth; shift: (2,) of the principal
    point, focal lengths; bend: (rows, columns) change of depth's logarithm, see `spot3d.calibration.Bend`, None = none;
    to_image: (3, 3) from an arm, a vector from the camera in the views' world, to its place in the image, 0..1 of the
    width and height, times its depth, and to that depth.
    """

    camera: NDArray[np.float64]
    step: NDArray[np.float64]
    linear: NDArray[np.float64]
    axes: NDArray[np.float64]
    factor: float
    shift: NDArray[np.float64]
    bend: NDArray[np.float64] | None
    to_image: NDArray[np.float64]

    @classmethod
    def of(cls, view: View, before: Placement, now: Placement) -> Self:
        """The change of a view from one calibration and pose to another."""
        axes, origin = np.split(view.pose.astype(np.float64), [3], axis=1)
        turn = _rotation(before.calibration.turn).T @ _rotation(now.calibration.turn)
        factor = now.calibration.depth_factor / before.calibration.depth_factor
        shift = np.subtract(now.calibration.centre, before.calibration.centre)
        # The inverse, not the transpose: single precision errors of a rotation must not add up over many changes.
        inverse = np.linalg.inv(axes)
        turned = _rotation(now.twist[3:]) @ _rotation(before.twist[3:]).T
        linear = factor * turned @ inverse @ turn @ sheared((shift[0], shift[1])) @ axes
        step = np.subtract(now.twist[:3], before.twist[:3])
        bend = before.calibration.straighter(now.calibration)
        (fx, fy, cx, cy), (h, w) = view.focal.tolist(), view.depth.shape
        lens = np.array(((fx / w, 0, (cx + 0.5) / w), (0, fy / h, (cy + 0.5) / h), (0, 0, 1)))
        camera, axes_now = -(inverse @ origin)[:, 0], turn.T @ axes @ turned.T
        return cls(camera, step, linear, axes_now, factor, shift, bend, lens @ view.pose[:, :3])

    def straightened(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """Logarithm, (...), of the factor by which (..., 3) points are straightened, before all else."""
        if self.bend is None:
            return np.zeros(points.shape[:-1])
        across, down, depth = np.moveaxis((points - self.camera) @ self.to_image.T, -1, 0)
        depth = np.maximum(depth, NEAREST)
        return bend_at(self.bend, across / depth, down / depth)

    def moved(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """The points, (..., 3), after the change."""
        arms = np.exp(self.straightened(points))[..., None] * (points - self.camera)
        return self.camera + self.step + arms @ self.linear.T


def changed_view(view: View, change: Change) -> View:
    """The view after the change."""
    millimetres = view.depth * change.factor
    if change.bend is not None:
        millimetres *= np.exp(bend_of_image(change.bend, view.depth.shape))
    millimetres = np.rint(millimetres)
    depth = np.where((view.depth < FAR) & (millimetres < FAR), millimetres, FAR).astype(np.uint16)
    origin = -change.axes @ (change.camera + change.step)
    pose = np.column_stack((change.axes, origin)).astype(np.float32)
    focal = view.focal.copy()
    focal[2:] -= (change.shift * view.focal[:2]).astype(np.float32)
    centre, reach = within_reach(depth, pose, focal, view.range_max)
    return replace(view, depth=depth, pose=pose, focal=focal, centre=centre, reach=reach)


def change_segments(segments: SegmentTable, rows: NDArray[np.int64], change: Change) -> None:
    """Move the segments of the keyframe that changes."""
    spheres, blur, support = segments.spheres.rows, segments.blur.rows, segments.support.rows
    # The support of a segment is bent as the segment is.
    nearer = np.exp(change.straightened(segments.places.rows[rows]).mean(axis=1))[:, None]
    for points in (segments.places.rows, segments.outline.rows):
        points[rows] = change.moved(points[rows])
    spheres[rows] = spheres_around(segments.places.rows[rows])
    blur[rows] = nearer * blur[rows] @ change.linear.T
    support[rows, 3] += (nearer[:, 0] - 1) * (support[rows, :3] @ change.camera + support[rows, 3])
    support[rows] = moved_planes(support[rows], change.linear, change.camera)
    support[rows, 3] -= support[rows, :3] @ change.step


def _rotation(vector: tuple[float, ...]) -> NDArray[np.float64]:
    return rotation_from_vector(np.array(vector))
