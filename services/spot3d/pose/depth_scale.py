"""By how much a depth camera's metres are longer than those of the poses that are given.

Depth cameras are true to a few per cent: what is two metres away is seen some centimetres too near or too far, wherever
one looks from, and views from two sides never meet, however good the poses are. Odometry on depth has the same wrong
metres and does not notice; with given poses it can be told: of what the map and a frame see from different places, the
scale that makes both meet is estimated along with the frame's pose and where the camera looks, and sharpened from frame
to frame (`CommonErrors`). Both lie where the given poses have them, for it: corrected ones follow what depth says,
wrong scale and all. What is off across the way between the views no scale explains; it shows what the poses' noise and
drift may look like along it. Where given poses are noisy, views tell little, and how far odometry goes beside them
tells the scale (`ErrorModel`), as far as odometry does not drift. The more certain of both counts the more.
"""

import math

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.evidence import CommonErrors, Registered, probability

# `NEWS_S` (`evidence`), `_STEP`, `_KNOWN` and `_MOST` with half and with twice their value: of 3 % on redkitchen and
# clutter, whose poses are exact, 0.1 to 1.2 % are left in the end by `NEWS_S`, 0.2 to 0.8 % by `_STEP`, the same by
# `_KNOWN` and `_MOST`; true depth stays (all of it from when only what is beyond two standard deviations was applied).
# A scale is never better known than this: depth is distorted over the image, and drifts with the camera's warmth.
_KNOWN = 0.003
# Odds that a camera's depth is of another scale than it says, before it was seen: what is applied is the scale times
# the probability that there is one. Of depth that is 3 or 1.5 % too short or long, or true, this is left, rms over the
# last two thirds, with poses shaken by 10 mm and odds of 0.1, 0.3, 1: redkitchen 1.8, 1.7, 1.6 %, TUM fr3/cabinet 1.9,
# 1.8, 1.6, rendered desks 0.5, 0.5, 0.4, clutter 1.1, 1.0, 1.0 (where only what is beyond two standard deviations is
# applied: 1.9, 2.0, 0.7, 1.2); and of true depth alone 0.2, 0.3, 0.5; 0.1, 0.2, 0.5; 0.0, 0.1, 0.1; 0.5, 0.6, 0.7.
_ODDS = 0.3
# Steps smaller than this move what is a metre away by less than the noise of a pixel.
_STEP = 0.003
# Keeps directions that no depth holds, as along a bare plane, out of what is seen across.
_RIDGE = 1e-6
# What is seen across is taken as it is from the first frame on.
_LEAST = 1e-9
# Further off than so many standard deviations no camera is, and no message says so: it is the poses that are wrong.
_MOST = 5.0
UNKNOWN = 0.0, np.inf
"""The scale by a path that tells nothing."""
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

    sigmas: (6,) how true the sensor is, see `CommonErrors`; the first is that of its depth's scale; 0: it is taken as
    it is.
    """

    def __init__(self, sigmas: NDArray[np.float64]) -> None:
        self.factor = 1.0
        self._sigma = float(sigmas[0])
        self._seen = CommonErrors(sigmas, _KNOWN)
        # A vector: each of its parts is about as large as the scale that the same noise makes.
        self._across = np.zeros(3)
        self._across_information = _LEAST

    def learn(self, frame: Registered, orientation: NDArray[np.float64], path: tuple[float, float]) -> float:
        """Take a registered frame into account; returns by what `factor` has changed.

        frame: seen with depth multiplied by `factor`, and with this `Orientation.vector` (5,). path: mean and variance
        of the logarithm of what depth would have to be multiplied by beside that for odometry to go as far as the given
        poses (see `ErrorModel.log_scale`).
        """
        if not self._sigma:
            return 1.0
        applied = np.log(self.factor)
        self._seen.learn(frame, np.append(applied, orientation))
        self._see_across(frame)
        mean, variance = self._believed(applied + path[0], path[1] + _KNOWN**2)
        sure = self._probability(mean, variance)
        if abs(sure * mean - applied) < _STEP:
            return 1.0
        before, self.factor = self.factor, float(np.exp(sure * mean))
        return self.factor / before

    def _believed(self, by_path: float, path_variance: float) -> tuple[float, float]:
        """Mean and variance of the scale's logarithm, by what was seen, which is as uncertain as what was seen across,
        and by how far odometry has gone."""
        prior, (mean, variance) = self._sigma**-2, self._seen.scale()
        seen = max(1 / variance - prior, _LEAST)
        chance = max(1 / seen, float(self._across @ self._across) / 3)
        by_views = float(np.clip(mean, -_MOST * self._sigma, _MOST * self._sigma)) / variance / seen
        variance = 1 / (prior + 1 / chance + 1 / path_variance)
        return variance * (by_views / chance + by_path / path_variance), variance

    def _probability(self, mean: float, variance: float) -> float:
        """That the scale is another than 1, if its logarithm is of this mean and variance where it is: either is as
        probable as what was seen is by it (Bayes factor of a spike and a slab: Mitchell and Beauchamp 1988)."""
        return probability(0.5 * mean**2 / variance + math.log(_ODDS * math.sqrt(variance) / self._sigma))

    def _see_across(self, frame: Registered) -> None:
        """What a scale would be, and is none: how far given poses are off across the distance of the views, as a share
        of it. As `learn`, of the shift alone, in units of its standard deviations."""
        held = frame.H[:6, :6] + _RIDGE * np.trace(frame.H[:6, :6]) * np.eye(6)
        covariance = np.linalg.inv(held) + np.linalg.inv(frame.pose_information)
        weight = np.linalg.cholesky(np.linalg.inv(covariance[:3, :3])).T
        apart = weight @ np.linalg.solve(held, frame.H[:6, 6])[:3]
        off = weight @ (np.linalg.solve(held, frame.g[:6]) - frame.given)[:3]
        information = frame.news * float(apart @ apart)
        total = self._across_information + information
        self._across += (frame.news * np.cross(apart, off) - information * self._across) / total
        self._across_information = min(total, _KNOWN**-2)
