"""By how much a depth camera's metres are longer than those of the poses that are given.

Depth cameras are true to a few per cent: what is two metres away is seen some centimetres too near or too far, wherever
one looks from, and views from two sides never meet, however good the poses are. Odometry on depth has the same wrong
metres and does not notice; with given poses it can be told: of what the map and a frame see from different places, the
scale that makes both meet is estimated along with the frame's pose, and sharpened from frame to frame (a Kalman
filter of one state).
"""

import numpy as np
from numpy.typing import NDArray

# The four below, with half and with twice their value: of 3 % on redkitchen and clutter, whose poses are exact, 0.1 to
# 1.2 % are left in the end by `_NEWS_S`, 0.2 to 0.8 % by `_STEP`, the same by `_KNOWN` and `_MOST`; true depth stays.
# Given poses are wrong alike over a third of a second: no sooner does a frame tell something new.
_NEWS_S = 1 / 3
# A scale is never better known than this: depth is distorted over the image, and drifts with the camera's warmth.
_KNOWN = 0.003
# What lies within so many standard deviations may be chance: the scale is taken as true until it surely is not. With 1
# to 3, and a sigma of 0.01 to 0.04, exact poses end as near to the truth on redkitchen and clutter (0.2 to 1.4 % of 3 %
# left), after more or less time; with 1 true depth is changed by 1 % where poses are shaken.
_SURE = 2.0
# Steps smaller than this move what is a metre away by less than the noise of a pixel.
_STEP = 0.003
# Further off than so many standard deviations no camera is, and no message says so: it is the poses that are wrong.
_MOST = 5.0
TOLD = 0.01
"""A scale that is off by less is not spoken of: data sheets promise no more."""


def told(factor: float) -> str:
    """What is wrong with depth that is to be multiplied by this, in words; empty where that is not worth a word."""
    off = 1 / factor - 1
    if abs(off) < TOLD:
        return ""
    return (
        f"depth is {abs(off):.1%} too {'long' if off > 0 else 'short'} for the given poses, and is corrected: "
        "calibrate the camera, or check the poses"
    )


class DepthScale:
    """What depth has to be multiplied by to agree with the given poses.

    sigma: how true the sensor's depth is, standard deviation of its scale; 0: it is taken as it is.
    """

    def __init__(self, sigma: float) -> None:
        self.factor = 1.0
        self._sigma = sigma
        self._information = sigma**-2 if sigma else np.inf
        self._log = 0.0
        self._dilution = 0.0  # what the noise of the given poses may look like

    def learn(
        self,
        H: NDArray[np.float64],
        g: NDArray[np.float64],
        pose_information: NDArray[np.float64],
        given: NDArray[np.float64],
        elapsed: float,
    ) -> float:
        """Take a registered frame into account; returns by what `factor` has changed.

        H (7, 7), g (7,): its normal equations for twist and scale (see `SurfelMap.normal_equations`), with depth
        already multiplied by `factor`, in units of independent information. given: (6,) twist from there to the given
        pose, which is known with pose_information (6, 6). elapsed: seconds since the last frame.
        """
        if not self._sigma:
            return 1.0
        # The pose may give way as far as it is uncertain: what is left tells the scale (Schur complement).
        A, b = H[:6, :6] + pose_information, g[:6] + pose_information @ given
        share = min(1.0, elapsed / _NEWS_S)
        information = share * (H[6, 6] - H[6, :6] @ np.linalg.solve(A, H[:6, 6]))
        gradient = share * (g[6] - H[6, :6] @ np.linalg.solve(A, b))
        applied = np.log(self.factor)
        total = self._information + information
        # Noise of the given poses is in what differs and in how far apart the views are, alike: it looks like a scale
        # of its variance over that of the distances (errors in variables).
        apart = H[6, 6] / max(float(np.trace(H[:3, :3])), 1e-12)
        noise = 3 / float(np.trace(pose_information[:3, :3]))
        self._dilution += information / total * (min(noise / max(apart, 1e-12), 1.0) - self._dilution)
        self._log += (gradient + information * (applied - self._log)) / total
        self._log = float(np.clip(self._log, -_MOST * self._sigma, _MOST * self._sigma))
        self._information = min(total, _KNOWN**-2)
        doubt = _SURE / np.sqrt(self._information) + self._dilution
        sure = max(0.0, 1.0 - (doubt / self._log) ** 2) if self._log else 0.0
        if abs(sure * self._log - applied) < _STEP:
            return 1.0
        before, self.factor = self.factor, float(np.exp(sure * self._log))
        return self.factor / before
