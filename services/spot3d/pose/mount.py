"""By how much the camera is turned against what the given poses are of.

A tracker is mounted by eye, and a principal point that is some pixels off is a turn by as many pixels: what is a metre
away then lies centimetres off, to another side from each view, and smears. Odometry on depth turns with its camera and
does not notice; with given poses it can be told: of what the map and a frame see from cameras that stand at a slant to
each other, the turn that makes both meet is estimated along with the frame's pose, and sharpened from frame to frame (a
Kalman filter of three states). About an axis around which the camera never turns it stays as it is: there it smears
nothing.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.trajectory import rotation_from_vector

# Given poses are wrong alike over a third of a second: no sooner does a frame tell something new.
_NEWS_S = 1 / 3
# A turn is never better known than this, radians: a pixel at VGA.
_KNOWN = 0.002
# What lies within so many standard deviations may be chance.
_SURE = 2.0
# Steps smaller than this, radians, move what is a metre away by less than the noise of a pixel.
_STEP = 0.002
# Further off than so many standard deviations no camera is mounted.
_MOST = 5.0
TOLD = 0.0087
"""A turn of less than half a degree is not spoken of."""


def told(turn: NDArray[np.float64]) -> str:
    """What is wrong with the given poses, in words; empty where that is not worth a word. turn: (3,) radians."""
    angle = float(np.linalg.norm(turn))
    if angle < TOLD:
        return ""
    about = ", ".join(f"{degrees:.1f}" for degrees in np.degrees(turn))
    return (
        f"the camera is turned by {np.degrees(angle):.1f} deg against the given poses ({about} about its x, y, z), and "
        "that is corrected: check its intrinsics, and how it is mounted"
    )


class MountTurn:
    """The rotation from the frame that the given poses are of to the camera's.

    sigma: how true the given poses' axes are, radians, standard deviation about each; 0: they are taken as they are.
    """

    def __init__(self, sigma: float) -> None:
        self.vector = np.zeros(3)
        self._sigma = sigma
        self._information = np.eye(3) / sigma**2 if sigma else np.zeros((3, 3))
        self._estimate = np.zeros(3)

    def applied(self, T_world_given: NDArray[np.float64]) -> NDArray[np.float64]:
        """The camera's pose (4, 4) by a given one."""
        if not self.vector.any():
            return T_world_given
        pose = T_world_given.copy()
        pose[:3, :3] = T_world_given[:3, :3] @ rotation_from_vector(self.vector)
        return pose

    def learn(
        self,
        H: NDArray[np.float64],
        g: NDArray[np.float64],
        pose_information: NDArray[np.float64],
        given: NDArray[np.float64],
        elapsed: float,
    ) -> NDArray[np.float64]:
        """Take a registered frame into account; returns by what (3,) `vector` has changed.

        H (10, 10), g (10,): its normal equations for twist, scale and turn (see `SurfelMap.normal_equations`), with
        `vector` applied already, in units of independent information. given: (6,) twist from there to the given pose,
        which is known with pose_information (6, 6) against the map. elapsed: seconds since the last frame.
        """
        if not self._sigma:
            return np.zeros(3)
        share = min(1.0, elapsed / _NEWS_S)
        A, b = H[:6, :6] + pose_information, g[:6] + pose_information @ given
        information = share * (H[7:, 7:] - H[7:, :6] @ np.linalg.solve(A, H[:6, 7:]))
        gradient = share * (g[7:] - H[7:, :6] @ np.linalg.solve(A, b))
        total = self._information + information
        self._estimate = self._estimate + np.linalg.solve(
            total, gradient + information @ (self.vector - self._estimate)
        )
        self._estimate = np.clip(self._estimate, -_MOST * self._sigma, _MOST * self._sigma)
        known, axes = np.linalg.eigh(total)
        known = np.minimum(known, _KNOWN**-2)
        self._information = (axes * known) @ axes.T
        along = axes.T @ self._estimate
        sure = np.maximum(0.0, 1.0 - _SURE**2 / np.maximum(known * along**2, 1e-12))
        vector = axes @ (sure * along)
        change: NDArray[np.float64] = vector - self.vector
        if np.linalg.norm(change) < _STEP:
            return np.zeros(3)
        self.vector = vector
        return change
