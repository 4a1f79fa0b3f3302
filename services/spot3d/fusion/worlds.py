"""Which poses belong to the map: those of its own world, at plausible places."""

from collections import deque
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from spot3d.camera_pose import REACH_M

Verdict = Literal["same", "begins", "implausible pose", "pose too far from the origin", "pose of an earlier epoch"]
"""The verdict on a pose; the last three: why a frame with a pose that is not lost is not fused."""

_JUMP_M = 0.5
"""Given poses jump this far where their own map is corrected, metres."""
_PAST = 16
"""Most earlier epochs that are remembered."""


def why_refused(verdict: str, T_world_camera: NDArray[np.float64]) -> str:
    """What is wrong with the place of a refused pose, (4, 4) metres, and what to do; otherwise empty."""
    place = ", ".join(f"{value:.3g}" for value in T_world_camera[:3, 3])
    text = f"the pose at ({place}) m is not used:"
    if verdict == "pose too far from the origin":
        reach = f"the map extends to {REACH_M:g} m from the origin of its world"
        return f"{text} {reach}; give poses in a world whose origin is nearby, such as the first pose"
    return (
        f"{text} its speed is above fusion.speed_max; check the poses' unit and timestamps"
        if verdict == "implausible pose"
        else ""
    )


class World:
    """The world of the map, identified by the epoch of its poses.

    speed_max: fastest plausible camera, m/s.
    """

    def __init__(self, speed_max: float) -> None:
        self._speed_max = speed_max
        self.epoch: str | None = None
        self._past: deque[str] = deque(maxlen=_PAST)
        self._begun = False
        self._last: tuple[int, NDArray[np.float64]] | None = None

    def judge(self, epoch: str | None, T_world_camera: NDArray[np.float64], stamp_ns: int) -> Verdict:
        """Whether a pose, (4, 4) metres, belongs to the map, begins another, or must not be used."""
        place = T_world_camera[:3, 3]
        if epoch is not None and epoch in self._past:
            return "pose of an earlier epoch"
        if not float(np.abs(place).max()) < REACH_M:
            return "pose too far from the origin"
        if self._begun and epoch != self.epoch:
            return "begins"
        if self._last is not None:
            elapsed = 1e-9 * abs(stamp_ns - self._last[0])
            if np.linalg.norm(place - self._last[1]) > _JUMP_M + self._speed_max * elapsed:
                return "implausible pose"
        return "same"

    def follow(self, epoch: str | None, T_world_camera: NDArray[np.float64], stamp_ns: int) -> None:
        """Record that a frame with this pose has been fused."""
        self.epoch, self._begun, self._last = epoch, True, (stamp_ns, T_world_camera[:3, 3].copy())

    def go_on(self, epoch: str | None) -> None:
        """Continue a map of this world that another process began."""
        self.epoch, self._begun, self._last = epoch, True, None

    def forget(self) -> None:
        """Forget the world, as the map is empty: the next pose begins one, in this world or another."""
        self.epoch, self._begun, self._last = None, False, None

    def leave(self) -> None:
        """Leave this world for another: poses of this one come too late."""
        if self.epoch is not None:
            self._past.append(self.epoch)
        self.forget()
