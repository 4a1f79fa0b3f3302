"""The pass-through: poses that come with the frames (data-set truth, a robot's own odometry)."""

import numpy as np

from spot3d.frame import RgbdFrame
from spot3d.pose.estimate import PoseEstimate
from spot3d.pose.motion import FARTHEST_M, checked_pose

_INVALID = f"the given pose is not a rigid transform, or farther than {FARTHEST_M / 1000:g} km from the origin"


class GivenPoses:
    """Passes on the pose of each frame; a frame without a valid one is lost."""

    def __init__(self) -> None:
        self._last = np.eye(4)

    def track(self, frame: RgbdFrame) -> PoseEstimate:
        """The given pose with its rotation made exact, or the last good one with status "lost"."""
        if frame.T_world_camera is None:
            return PoseEstimate(self._last, "lost", "the frame has no given pose")
        pose = checked_pose(frame.T_world_camera)
        if pose is None:
            return PoseEstimate(self._last, "lost", _INVALID)
        self._last = pose
        return PoseEstimate(pose, "ok")
