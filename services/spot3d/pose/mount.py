"""By how much the camera is turned against what the given poses are of.

A tracker is mounted by eye: what is a metre away then lies centimetres off, to another side from each view, and smears.
A principal point that is some pixels off shears what is seen, which is a turn by about half as many pixels and a strain
that stays. Odometry on depth turns with its camera and
does not notice; with given poses it can be told: of what the map and a frame see from cameras that stand at a slant to
each other, the turn that makes both meet is estimated along with the frame's pose, and sharpened from frame to frame (a
Kalman filter of three states). About an axis around which the camera never turns it stays as it is: there it smears
nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.evidence import evidence
from spot3d.trajectory import rotation_from_vector

# With `_KNOWN` and `_STEP` half and twice as large, as much is found to 0.15 deg on clutter, redkitchen (16 pixels of
# 640, a tracker turned by 1 deg) and on TUM fr3/cabinet, and nothing where poses are exact or shaken by 10 mm; the same
# with `mount_turn_sigma` twice as large, and with half of it two thirds to three quarters.
# A turn is never better known than this, radians: a pixel at VGA.
_KNOWN = 0.002
# What lies within so many standard deviations may be chance. With 1, 2 and 3, redkitchen is turned by 0.4, 0 and 0 deg
# with its own poses and by 0.6, 0.1 and 0 shaken by 5 mm (its principal point is some two pixels off); of 1 deg on
# clutter 0.9, 0.9 and 0.7 are found, of 16 pixels 1.1, 0.9 and 0.4 deg, on fr3/cabinet 0.8, 0.5 and 0.
_SURE = 2.0
# Steps smaller than this, radians, move what is a metre away by less than twice the noise of a pixel.
_STEP = 0.002
TOLD = math.radians(0.5)
"""A turn that is less is not spoken of: half a degree is what a bracket is mounted to."""


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
        information, gradient = evidence(H, g, slice(7, 10), pose_information, given, elapsed)
        total = self._information + information
        self._estimate = self._estimate + np.linalg.solve(
            total, gradient + information @ (self.vector - self._estimate)
        )
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
