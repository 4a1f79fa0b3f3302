"""A camera's pose as fusion takes it: where it is, and what has become known by then."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import NOMINAL, Calibration
from spot3d.pose_corrections import PoseCorrections


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Where a frame's camera is, and what is known with it of the poses before and of the camera.

    T_world_camera: (4, 4) float64. T_world_map: (4, 4) float64, where the map of poses lies by now, and the objects
    with it (see `PoseEstimate`); None: it stays. given_by: who gives the poses: another one's map begins where that of
    before lay. calibration: by which this frame and the keyframes before are to be seen, as far as is known by now; the
    pose is turned by it already. As told: nothing is known but what somebody else said before. corrections: of the
    poses of frames before; None: as they were with the frame before, if the same one gives the poses.
    """

    T_world_camera: NDArray[np.float64]
    T_world_map: NDArray[np.float64] | None = None
    given_by: str | None = None
    calibration: Calibration = NOMINAL
    corrections: PoseCorrections | None = None
