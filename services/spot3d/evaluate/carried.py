"""Maps true objects into the world of a run's own poses, by the frames that see them.

Odometry bends the world by centimetres over metres, and so do recorded poses that count as true. A single rigid
transform would then charge a box with the errors of the path before it, although the box fits where the camera was.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import moved
from spot3d.camera import Intrinsics, invert
from spot3d.evaluate.projection import box_surface, measured_at
from spot3d.evaluate.truth import LabelledScene
from spot3d.pose.motion import moved as corrected
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import nearest_rotation

_POINTS = 300
"""About this many points of an object are tested for visibility in a frame."""
_SEEN = 0.2
"""A frame sees an object if it measures this share of its points. Two of a box's six sides make a third.

On redkitchen with KISS-ICP, 0.1 to 0.3, and 1 to 3 cm for `_AGREES`, give F within 0.3. 0.5 does not."""
_AGREES = 0.02
"""Depth agrees with a point within this plus three sigma of its noise, metres: labels and poses are no more accurate.
"""


class _Carrier(NamedTuple):
    """A frame that sees an object: stamp, pose (4, 4) in the map of the run's poses, and inverse true pose (4, 4)."""

    stamp_ns: int
    T_map_camera: NDArray[np.float64]
    T_camera_true: NDArray[np.float64]


class Sightings:
    """The frames that see each true object, and the transform into the run's world that each of them gives.

    T_world_map: (4, 4), the pose of the run's map as the last frame knows it. It changes as it is refined.
    """

    def __init__(self, truth: LabelledScene) -> None:
        self._truth = truth
        self.T_world_map = np.eye(4)
        self._samples = [
            _some(points) if len(points := truth.xyz[truth.label == label]) else box_surface(box)
            for label, box in zip(truth.labels, truth.boxes, strict=True)
        ]
        self._carriers: list[list[_Carrier]] = [[] for _ in truth.boxes]
        # By their first stamp, which rises from one to the next.
        self._corrections: dict[int, PoseCorrections] = {}

    def add(
        self,
        depth: NDArray[np.float32],
        camera: Intrinsics,
        T_true_camera: NDArray[np.float64],
        T_run_camera: NDArray[np.float64],
        T_world_map: NDArray[np.float64] | None = None,
        stamp_ns: int = 0,
    ) -> None:
        """Test which objects a frame sees. depth: (h, w) float32 metres, 0 = invalid; poses (4, 4) float64.

        T_world_map: the pose of the run's map at that time; None: the map does not move. stamp_ns: of the frame, for
        `correct`.
        """
        self.T_world_map = np.eye(4) if T_world_map is None else T_world_map
        carrier = _Carrier(stamp_ns, invert(self.T_world_map) @ T_run_camera, invert(T_true_camera))
        for sample, carriers in zip(self._samples, self._carriers, strict=True):
            if _share_seen(sample, depth, camera, carrier.T_camera_true) >= _SEEN:
                carriers.append(carrier)

    def correct(self, corrections: PoseCorrections) -> None:
        """Add the run's later corrections of poses that are added already."""
        self._corrections[int(corrections.stamps_ns[0])] = corrections

    def transforms(self, T_run_true: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """T_run_true (4, 4) of each object: the median over the frames that see it, or the given one if none does."""
        pairs = zip(self._truth.boxes, self._carriers, strict=True)
        return [
            _median(np.array([self._carried(carrier) for carrier in carriers]), box.centre) if carriers else T_run_true
            for box, carriers in pairs
        ]

    def _carried(self, carrier: _Carrier) -> NDArray[np.float64]:
        """T_run_true (4, 4) by one frame, from its finally corrected pose."""
        T_run_camera = self.T_world_map @ carrier.T_map_camera
        for corrections in reversed(self._corrections.values()):
            if (twist := corrections.at(carrier.stamp_ns)) is not None:
                T_run_camera = corrected(T_run_camera, twist)
                break
        return T_run_camera @ carrier.T_camera_true

    def carried(self, T_run_true: NDArray[np.float64]) -> LabelledScene:
        """The truth in the run's world: each object's box and points are moved by its own transform.

        Points of no object (background, ignored) move with the object whose centre is nearest, so that a box is judged
        with the table under it. T_run_true (4, 4) moves objects that no frame sees, and the points of a scene without
        objects.
        """
        truth, transforms = self._truth, self.transforms(T_run_true)
        xyz = truth.xyz.astype(np.float64)
        owner = np.full(len(xyz), -1)
        if transforms:
            centres = np.array([box.centre for box in truth.boxes])
            owner = np.array([np.square(xyz - centre).sum(axis=1) for centre in centres]).argmin(axis=0)
            for number, label in enumerate(truth.labels):
                owner[truth.label == label] = number
        placed = xyz @ T_run_true[:3, :3].T + T_run_true[:3, 3]
        for number, T in enumerate(transforms):
            own = owner == number
            placed[own] = xyz[own] @ T[:3, :3].T + T[:3, 3]
        boxes = tuple(moved(box, T) for box, T in zip(truth.boxes, transforms, strict=True))
        up = T_run_true[:3, :3] @ truth.up
        return LabelledScene(truth.names, truth.labels, boxes, up, placed.astype(np.float32), truth.label)


def _some(points: NDArray[np.float32]) -> NDArray[np.float64]:
    return points[:: max(1, len(points) // _POINTS)].astype(np.float64)


def _share_seen(
    points: NDArray[np.float64], depth: NDArray[np.float32], camera: Intrinsics, T_camera_world: NDArray[np.float64]
) -> float:
    """Share of (n, 3) world points that project into the image and agree with its depth."""
    local = points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    expected, measured = measured_at(local, depth, camera)
    agrees = (measured > 0) & (np.abs(measured - expected) <= _AGREES + 3 * camera.noise.sigma(expected))
    return float(np.count_nonzero(agrees) / len(points))


def _median(transforms: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median (4, 4) of (n, 4, 4) transforms: of their rotations, and of where they move `centre` (3,).

    The translation is taken at the object's own centre. At the world's origin, rotation and translation would come from
    different frames and not fit together.
    """
    T = np.eye(4)
    T[:3, :3] = nearest_rotation(np.median(transforms[:, :3, :3], axis=0))
    placed = np.median(transforms[:, :3, :3] @ centre + transforms[:, :3, 3], axis=0)
    T[:3, 3] = placed - T[:3, :3] @ centre
    return T
