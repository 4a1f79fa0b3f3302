"""Scale of a depth camera against the given poses.

Depth cameras are accurate to a few per cent: at two metres depth is some centimetres too short or too long from every
side, so that views from two sides never agree, however good the poses are. Odometry on depth has the same wrong scale
and does not notice. With given poses the scale can be estimated (see `Adjustment`).
"""

import numpy as np

from spot3d.pose.common_errors import COMMON, CommonErrors, believed

# Least change of the scale: at a metre it is less than half of a pixel's noise, but in the same direction everywhere.
# With 0.003 near desks with depth 3 % too short, poses shaken by 10 mm, have an IoU of 0.69, not 0.71, and as a
# hand-held Kinect sees them 0.61, not 0.63; redkitchen is the same.
_STEP = 0.001
# Largest scale that is applied or reported, in stated standard deviations: beyond it the poses are wrong.
_MOST = 5.0
NOTABLE = 0.01
"""Smaller deviations are not reported: data sheets promise no more."""


def notice(factor: float) -> str:
    """Text for people about depth that is to be multiplied by this; empty where it is not notable."""
    off = 1 / factor - 1
    if abs(off) < NOTABLE:
        return ""
    return (
        f"depth is {abs(off):.1%} too {'long' if off > 0 else 'short'} for the given poses; this is corrected, but "
        "calibrate the camera, or check the poses"
    )


def decided(errors: CommonErrors, factor: float) -> float:
    """The factor by which depth agrees with the given poses, as estimated so far (see `believed`).

    factor: the one decided before, which is kept where the change would be small.
    """
    if 0 not in errors.free:
        return factor
    most = _MOST * float(errors.sigmas[0])
    log_scale = float(np.clip(believed(errors, np.array([0]), np.full(COMMON, np.nan))[0], -most, most))
    return factor if abs(log_scale - np.log(factor)) < _STEP else float(np.exp(log_scale))
