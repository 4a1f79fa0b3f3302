"""By how much the camera looks elsewhere than the given poses and its intrinsics say.

A tracker is mounted by eye: what is a metre away then lies centimetres off, to another side from each view, and smears.
A principal point that is some pixels off, as a driver's is from a calibrated one, does the same, and shears what is
seen as well. Odometry on depth turns with its camera and does not notice; with given poses it can be told from what is
seen by cameras that stand at a slant to each other (see `Adjustment`). A table alone does not tell the one from the
other; what stands on it does. About an axis around which the camera never turns it stays as it is: there it smears
nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration
from spot3d.pose.common_errors import COMMON, CommonErrors, believed

# Depth that is bent looks more like a turn, or a centre that is off, than like another scale: so much of the share is
# trusted that the scale is decided by. With 0.36 nothing is found of a tracker mounted 1 deg otherwise than told, on a
# desk seen from near with poses shaken by 10 mm, with this 0.7 deg; with 1 redkitchen, shaken by 20 mm, is turned by
# 0.8 deg for nothing.
_ALIKE = 0.45
# Steps smaller than this, radians, move what is a metre away by less than twice the noise of a pixel.
_STEP = 0.002
NOTABLE = math.radians(0.5)
"""A turn, or an offset of the principal point in focal lengths, that is less is not spoken of: half a degree is what a
bracket is mounted to."""


def notice(known: Calibration) -> str:
    """What is wrong with the given poses or the intrinsics, in words; empty where that is not worth a word."""
    angle, offset = math.hypot(*known.turn), math.hypot(*known.centre)
    found = []
    if angle >= NOTABLE:
        about = ", ".join(f"{math.degrees(part):.1f}" for part in known.turn)
        found.append(
            f"the camera is turned by {math.degrees(angle):.1f} deg against the given poses ({about} about its x, y, z)"
        )
    if offset >= NOTABLE:
        x, y = (f"{100 * part:+.1f}" for part in known.centre)
        found.append(f"cx and cy are too large by {x} and {y} % of the focal length")
    if not found:
        return ""
    return f"{' and '.join(found)}, and that is corrected: check its intrinsics, and how it is mounted"


def decided(errors: CommonErrors, vector: NDArray[np.float64], log_scale: float) -> NDArray[np.float64]:
    """The rotation vector (3,) from the frame that given poses are of to the camera's, radians about its axes, and the
    offset (2,) of its principal point (see `Calibration`), by what is known by now.

    vector: (5,) as it was decided before; it stays where it would hardly change. log_scale: the logarithm of what depth
    is multiplied by: what is believed (see there) of turn and centre is as they are if that is right.
    """
    free = errors.free[errors.free > 0]
    if not len(free):
        return vector
    known = np.full(COMMON, np.nan)
    known[0] = log_scale
    now = np.zeros(5)
    now[free - 1] = believed(errors, free, known, _ALIKE)
    return vector if np.linalg.norm(now - vector) < _STEP else now
