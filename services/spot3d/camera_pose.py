"""A camera's pose as fusion takes it, with the corrections known by then."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import NOMINAL, Calibration
from spot3d.pose_corrections import PoseCorrections

REACH_M = 2000.0
"""Farthest place along each axis of a pose that is fused: the map's voxels of 5 mm wrap beyond 2.6 km from the origin;
no room is so large."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """The pose of a frame's camera, with what is known by then about earlier poses and the camera.

    T_world_camera: (4, 4) float64. T_world_map: (4, 4) float64, the present pose of the map of poses, with which the
    objects move (see `PoseEstimate`); None: it does not move. given_by: the pose provider; the map of a new provider
    starts where the previous one's lay. calibration: of this frame and the keyframes before, as far as known by now;
    the pose includes its turn. NOMINAL: nothing is known beyond what another provider said before. corrections: of
    earlier frames' poses; None: as with the frame before, if it is from the same provider.
    """

    T_world_camera: NDArray[np.float64]
    T_world_map: NDArray[np.float64] | None = None
    given_by: str | None = None
    calibration: Calibration = NOMINAL
    corrections: PoseCorrections | None = None
