"""By how much a depth camera's metres are longer than those of the poses that are given.

Depth cameras are true to a few per cent: what is two metres away is seen some centimetres too near or too far, wherever
one looks from, and views from two sides never meet, however good the poses are. Odometry on depth has the same wrong
metres and does not notice; with given poses it can be told (see `Adjustment`).
"""

import numpy as np

from spot3d.pose.common_errors import COMMON, CommonErrors, believed

# Steps smaller than this move what is a metre away by less than half of a pixel's noise, but to the same side wherever
# it is seen: with 0.003 near desks of which depth is 3 % too short, poses shaken by 10 mm, have an IoU of 0.69
# in the place of 0.71, and as a hand-held Kinect sees them 0.61 in the place of 0.63; redkitchen is the same.
_STEP = 0.001
# Further off than so many standard deviations no camera is, and no message says so: it is the poses that are wrong.
_MOST = 5.0
NOTABLE = 0.01
"""A scale that is off by less is not spoken of: data sheets promise no more."""


def notice(factor: float) -> str:
    """What is wrong with depth that is to be multiplied by this, in words; empty where that is not worth a word."""
    off = 1 / factor - 1
    if abs(off) < NOTABLE:
        return ""
    return (
        f"depth is {abs(off):.1%} too {'long' if off > 0 else 'short'} for the given poses, and is corrected: "
        "calibrate the camera, or check the poses"
    )


def decided(errors: CommonErrors, factor: float) -> float:
    """What depth has to be multiplied by to agree with the given poses, by what is known by now (see `believed`).

    factor: as it was decided before; it stays where it would hardly change.
    """
    if 0 not in errors.free:
        return factor
    most = _MOST * float(errors.sigmas[0])
    log_scale = float(np.clip(believed(errors, np.array([0]), np.full(COMMON, np.nan))[0], -most, most))
    return factor if abs(log_scale - np.log(factor)) < _STEP else float(np.exp(log_scale))
