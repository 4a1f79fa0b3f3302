"""By how much the camera looks elsewhere than the given poses and its intrinsics say.

A tracker is mounted by eye: what is a metre away then lies centimetres off, to another side from each view, and smears.
A principal point that is some pixels off, as a driver's is from a calibrated one, does the same, and shears what is
seen as well. Odometry on depth turns with its camera and does not notice; with given poses it can be told: of what the
map and a frame see from cameras that stand at a slant to each other, the turn and the principal point that make both
meet are estimated along with the frame's pose and depth's scale, and sharpened from frame to frame (`CommonErrors`). A
table alone does not tell the one from the other; what stands on it does. About an axis around which the camera never
turns it stays as it is: there it smears nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration
from spot3d.pose.evidence import CommonErrors, Registered
from spot3d.trajectory import rotation_from_vector

# Of the turn alone, with `_KNOWN` and `_STEP` half and twice as large, as much is found to 0.15 deg on clutter,
# redkitchen (16 pixels of 640, a tracker turned by 1 deg) and on TUM fr3/cabinet, and nothing where poses are exact or
# shaken by 10 mm; the same with `mount_turn_sigma` twice as large, and with half of it two thirds to three quarters.
# With `centre_sigma` 0.014, 0.02 and 0.03, clutter whose principal point is 16 pixels too low or high ends at a mean
# IoU of 0.58, 0.60, 0.58 and 0.70, 0.71, 0.71 (0.49 and 0.60 with the turn alone), redkitchen with the first and the
# last at 0.69 and 0.70 (0.63).
# Neither is ever better known than this, radians: a pixel at VGA.
_KNOWN = 0.002
# Steps smaller than this, radians, move what is a metre away by less than twice the noise of a pixel.
_STEP = 0.002
TOLD = math.radians(0.5)
"""A turn, or an offset of the principal point in focal lengths, that is less is not spoken of: half a degree is what a
bracket is mounted to."""


def told(known: Calibration) -> str:
    """What is wrong with the given poses or the intrinsics, in words; empty where that is not worth a word."""
    angle, offset = math.hypot(*known.turn), math.hypot(*known.centre)
    found = []
    if angle >= TOLD:
        about = ", ".join(f"{math.degrees(part):.1f}" for part in known.turn)
        found.append(
            f"the camera is turned by {math.degrees(angle):.1f} deg against the given poses ({about} about its x, y, z)"
        )
    if offset >= TOLD:
        x, y = (f"{100 * part:+.1f}" for part in known.centre)
        found.append(f"cx and cy are too large by {x} and {y} % of the focal length")
    if not found:
        return ""
    return f"{' and '.join(found)}, and that is corrected: check its intrinsics, and how it is mounted"


class Orientation:
    """The rotation from the frame that the given poses are of to the camera's, and its principal point's offset.

    sigmas: (6,) how true depth's scale, the given poses' axes and the principal point are, see `CommonErrors`; of the
    last five, 0: it is taken as it is.
    """

    def __init__(self, sigmas: NDArray[np.float64]) -> None:
        self.vector = np.zeros(5)
        self._free = np.flatnonzero(sigmas[1:])
        self._seen = CommonErrors(sigmas, _KNOWN)

    @property
    def turn(self) -> tuple[float, float, float]:
        """Rotation vector about the camera's axes, radians."""
        x, y, z = self.vector[:3].tolist()
        return x, y, z

    @property
    def centre(self) -> tuple[float, float]:
        """Offset of the principal point (see `Calibration`)."""
        x, y = self.vector[3:].tolist()
        return x, y

    def applied(self, T_world_given: NDArray[np.float64]) -> NDArray[np.float64]:
        """The camera's pose (4, 4) by a given one."""
        if not self.vector[:3].any():
            return T_world_given
        pose = T_world_given.copy()
        pose[:3, :3] = T_world_given[:3, :3] @ rotation_from_vector(self.vector[:3])
        return pose

    def learn(self, frame: Registered, log_scale: float) -> NDArray[np.float64]:
        """Take a registered frame into account; returns by what (5,) `vector` has changed.

        frame: seen with `vector` applied, and with depth multiplied by the exponential of log_scale.
        """
        change = np.zeros(5)
        if not len(self._free):
            return change
        self._seen.learn(frame, np.append(log_scale, self.vector))
        estimate, information = self._seen.orientation(log_scale)
        # Chance alone makes of it as much as there are unknowns, on average. With 4, 5 (their number), 6 and 8 clutter
        # whose principal point is 16 pixels too high ends at a mean IoU of 0.69, 0.65, 0.64, 0.61; 16 too low: 0.60,
        # 0.57, 0.56, 0.50; 8 too low: 0.66, 0.63, 0.62, 0.60 (where each direction has to be sure by itself 0.56, 0.50,
        # 0.64); with 4 redkitchen is turned by 0.1 deg with its own poses.
        square = float(estimate @ information @ estimate)
        sure = max(0.0, 1.0 - len(self._free) / square) if square else 0.0
        change[self._free] = sure * estimate - self.vector[self._free]
        if np.linalg.norm(change) < _STEP:
            return np.zeros(5)
        self.vector = self.vector + change
        return change
