"""Choice of keyframes: frames that show something new, and one now and then from a camera that stands still."""

import numpy as np
from numpy.typing import NDArray

from spot3d.segments.settings import SegmentsSettings


class Keyframes:
    """Chooses keyframes by capture time and by the camera's motion since the last keyframe."""

    def __init__(self, settings: SegmentsSettings) -> None:
        self._settings = settings
        self._stamp_ns: int | None = None
        self._T_world_camera: NDArray[np.float64] = np.eye(4)
        self._latest_ns = 0

    def is_keyframe(self, stamp_ns: int, T_world_camera: NDArray[np.float64]) -> bool:
        """Whether the frame with this timestamp and pose is a keyframe. Call it for every frame with a pose, in order.

        T_world_camera: (4, 4) float64. The first frame is a keyframe, and so is one whose timestamp goes back, where
        another recording begins.
        """
        if not self._settings.enabled:
            return False
        begins = self._stamp_ns is None or stamp_ns < self._latest_ns
        self._latest_ns = stamp_ns
        if not begins and not self._due(stamp_ns, T_world_camera):
            return False
        self._stamp_ns, self._T_world_camera = stamp_ns, T_world_camera.copy()
        return True

    def _due(self, stamp_ns: int, T_world_camera: NDArray[np.float64]) -> bool:
        settings, elapsed_s = self._settings, 1e-9 * (stamp_ns - (self._stamp_ns or 0))
        if elapsed_s < settings.interval_s:
            return False
        moved = float(np.linalg.norm(T_world_camera[:3, 3] - self._T_world_camera[:3, 3]))
        # |R - I| = 2 sqrt(2) sin(angle / 2) for every rotation R, and unlike its trace it is exact for small angles.
        turned = np.linalg.norm(T_world_camera[:3, :3] - self._T_world_camera[:3, :3]) / np.sqrt(8)
        angle = 2 * float(np.arcsin(min(1.0, float(turned))))
        return moved > settings.motion_m or angle > settings.motion_rad or elapsed_s >= settings.still_s
