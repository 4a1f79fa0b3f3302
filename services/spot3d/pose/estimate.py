"""A pose provider's estimate for a frame."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import NOMINAL, Calibration
from spot3d.frame import RgbdFrame
from spot3d.pose_corrections import PoseCorrections

GIVEN_TOO_FAR = "given pose too far from the origin"
"""Event of a remark about where the world begins."""
GIVEN_JUMPED = "given poses jumped: the map that corrects them began anew"
"""Event of a frame with which the map is restarted."""
GIVEN_OTHERWISE = "are the given poses camera-to-world, in metres, of a camera with x right, y down, z forward?"
"""What people should check about poses that jump, or with which views do not agree."""


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Camera pose of one frame.

    T_world_camera: (4, 4) float64; while status is "lost" it is the last good pose and must not be fused.
    reason: why tracking is lost, for people; empty while status is "ok".
    forgotten: number of surfels and landmarks that the full maps dropped for this frame's.
    restarted: the given poses jumped away from the local map, which began anew with this frame.
    T_world_map: (4, 4) float64, latest place in the world of the map by which poses are corrected: it moves, and what
    earlier frames saw moves with it; None: the map stays.
    delay_s: assumed delay of the given pose behind the image; T_world_camera is the pose at the time of the image.
    calibration: to be applied to the frame so that it agrees with the given poses; the pose is turned by it.
    remark: what people should know about the given poses, told with one frame; mostly empty.
    corrections: of earlier frames' poses, where there are new ones; None: no change.
    """

    T_world_camera: NDArray[np.float64]
    status: Literal["ok", "lost"]
    reason: str = ""
    forgotten: int = 0
    restarted: bool = False
    T_world_map: NDArray[np.float64] | None = None
    delay_s: float = 0.0
    calibration: Calibration = NOMINAL
    corrections: PoseCorrections | None = None
    remark: str = ""


class PoseTracker(Protocol):
    """Any pose provider: one estimate for each frame, in the order of the stamps."""

    def track(self, frame: RgbdFrame) -> PoseEstimate:
        """Pose of the frame, which may carry a given one."""
