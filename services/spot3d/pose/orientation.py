"""Turn of the camera against the given poses, and offset of its principal point.

A tracker is mounted by eye: points a metre away then lie centimetres off, in another direction from each view, and
objects smear. A principal point that is some pixels off, as a driver's is from a calibrated one, does the same, and
also shears. Odometry on depth turns with its camera and does not notice. With given poses, both can be estimated from
views at a slant to each other (see `Adjustment`). A table alone does not distinguish them, the objects on it do. The
turn about an axis around which the camera never turns stays as it is, since it smears nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration
from spot3d.pose.common_errors import COMMON, CommonErrors, believed

# Factor on the trusted share of information, beside that for the scale: a bend of depth looks more like a turn, or an
# offset of the centre, than like a scale. With 0.36 nothing is found of a tracker mounted 1 deg off, on a desk seen
# from near with poses shaken by 10 mm, with this 0.7 deg; with 1 redkitchen, shaken by 20 mm, is wrongly turned by
# 0.8 deg.
_ALIKE = 0.45
# Least change, radians: smaller ones move points a metre away by less than twice the noise of a pixel.
_STEP = 0.002
NOTABLE = math.radians(0.5)
"""A smaller turn, or offset of the principal point in focal lengths, is not reported: brackets are mounted to half a
degree."""


def notice(known: Calibration) -> str:
    """Text for people about turn and principal point; empty where neither is notable."""
    angle, offset = math.hypot(*known.turn), math.hypot(*known.centre)
    found = []
    if angle >= NOTABLE:
        about = ", ".join(f"{math.degrees(part):.1f}" for part in known.turn)
        found.append(
            f"the camera is rotated by {math.degrees(angle):.1f} deg against the given poses ({about} deg about "
            "its x, y, z axes)"
        )
    if offset >= NOTABLE:
        x, y = (f"{100 * part:+.1f}" for part in known.centre)
        found.append(f"cx and cy are too large by {x} and {y} % of the focal length")
    if not found:
        return ""
    return f"{' and '.join(found)}; this is corrected, but check its intrinsics and its mount"


def decided(errors: CommonErrors, vector: NDArray[np.float64], log_scale: float) -> NDArray[np.float64]:
    """The rotation vector (3,) from the frame of the given poses to the camera's, radians about its axes, and the
    offset (2,) of its principal point (see `Calibration`), as estimated so far.

    vector: (5,) decided before, which is kept where the change would be small. log_scale: logarithm of the factor of
    depth, taken as exact in the estimate (see `believed`).
    """
    free = errors.free[errors.free > 0]
    if not len(free):
        return vector
    known = np.full(COMMON, np.nan)
    known[0] = log_scale
    now = np.zeros(5)
    now[free - 1] = believed(errors, free, known, _ALIKE)
    return vector if np.linalg.norm(now - vector) < _STEP else now
