"""How wrong given poses and odometry each are, and the scale between them, from how they come to differ.

Given poses (motion capture, a robot's own odometry, late stamps) are wrong by as much at any time, alike for a moment;
odometry on depth is sharp from frame to frame, drifts, and has depth's scale. Real depth is bent, each camera's in its
own way, and a scene holds odometry well or badly: how much it drifts is not known beforehand. So it is followed with
several drifts at once, each as a share of the given poses' noise, and each counts by how well it has foretold the given
poses (a bank of Kalman filters: Magill 1965). Its innovations tell the noise, and its seventh state the scale.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.motion import twist

# `_MEMORY_S` with half of its value, and with `_OUTLIER` with twice it: of a desk, clutter and redkitchen with poses
# shaken by 10 mm and depth 3 % too short what is seen lies within 0.4 mm as far apart.
# Given poses are compared so far apart, seconds: then what is wrong with them is another thing each time (correlated by
# a twentieth). With half a second and two redkitchen lies 17 and 18 mm apart in the place of 15.5, the others as far.
_APART_S = 1.0
# What was seen counts for about so long, seconds.
_MEMORY_S = 30.0
# Drifts that are tried: variance a second, in units of that of a registration whose surface is worth one point of
# independent noise, over the given poses', in units of the stated one. Rendered desks whose poses are off by 10 mm have
# the least, redkitchen and TUM fr3/cabinet 0.1 to 1, redkitchen with its own poses the most.
_DRIFTS = 10.0 ** np.arange(-2, 3)
# A difference counts up to so many standard deviations: a given pose that jumps tells nothing of the others.
_OUTLIER = 3.0
# So little is left of what was seen before a long pause; it still tells how wrong the poses are.
_FEWEST = 1e-9
# Variance of what is not known at first, in units of the given poses'; and their least.
_ANY, _LEAST = 1e4, 1e-6
# A direction that is known less than this, over the best known one, counts as known by so much: keeps the inverse
# finite along a bare plane, and lies under the 2e-4 that real and rendered scenes have at least (`correction._HELD`).
_UNKNOWN = 1e-6
_SHIFT, _TURN, _SCALE = slice(0, 3), slice(3, 6), 6


class _Posed(NamedTuple):
    """When (seconds) and where (4, 4, map) odometry had the camera."""

    time_s: float
    pose: NDArray[np.float64]


class ErrorModel:
    """Estimates the errors along the way.

    sigma: (6,) stated standard deviation of given poses, metres and radians. given: variance of the given poses, in
    units of the stated one; drift: variance by which odometry gets worse in a second, in units of that of a
    registration whose surface is worth one point of independent noise; both 0 before they are known.
    """

    def __init__(self, sigma: NDArray[np.float64]) -> None:
        self.given = self.drift = 0.0
        self._sigma = sigma
        # By drift: shift and turn of the given pose against odometry's, in stated units, and the logarithm of the
        # scale, in those of the shift a metre; and its covariance over the variance of the given poses.
        self._mean = np.zeros((len(_DRIFTS), 7))
        self._covariance = np.tile(_ANY * np.eye(7), (len(_DRIFTS), 1, 1))
        # By drift: sums of the logarithm of the determinant that was expected, of squares over it, and of numbers.
        self._sums = np.zeros((len(_DRIFTS), 3))
        self._last: _Posed | None = None

    def learn(
        self,
        time_s: float,
        T_map_odometry: NDArray[np.float64],
        T_map_given: NDArray[np.float64],
        information: NDArray[np.float64],
    ) -> float:
        """Take a frame into account, (4, 4) in odometry's map and as it was given; returns `drift`.

        information: (6, 6) of its registration, map axes, in units of the stated uncertainty, if its surface were worth
        one point of independent noise.
        """
        now = _Posed(time_s, T_map_odometry)
        offset = twist(T_map_odometry, T_map_given) / self._sigma
        if self._last is None or time_s - self._last.time_s >= _APART_S:
            self._foretell(now, offset, _spread(information))
        return self.drift

    def rescaled(self, factor: float) -> None:
        """Depth is `factor` times as large from here on."""
        self._mean[:, _SCALE] -= np.log(factor) / self._sigma[0]

    def interrupt(self) -> None:
        """The given poses have jumped, or odometry begins anew: where the one has the other is unknown again."""
        self._last = None
        pose = slice(0, 6)
        self._covariance[:, pose, :] = self._covariance[:, :, pose] = 0
        self._covariance[:, pose, pose] = _ANY * np.eye(6)

    @property
    def _seen(self) -> float:
        """How many numbers were foretold."""
        return float(self._sums[0, 2])

    def _foretell(self, now: _Posed, offset: NDArray[np.float64], spread: NDArray[np.float64]) -> None:
        """Foretell the given pose by each of the filters, and learn from how far it is off."""
        last, self._last = self._last, now
        transition, elapsed = np.eye(7), 0.0
        if last is not None:
            elapsed, step = now.time_s - last.time_s, now.pose[:3, 3] - last.pose[:3, 3]
            transition[:6, :6] = self._lever(step)
            transition[_SHIFT, _SCALE] = step
            self._sums *= np.exp(-elapsed / _MEMORY_S)
        most = 6 * _OUTLIER**2 * (self._variances() if self._seen else np.full(len(_DRIFTS), np.inf))
        for k, drift in enumerate(_DRIFTS):
            mean = transition @ self._mean[k]
            covariance = transition @ self._covariance[k] @ transition.T
            covariance[:6, :6] += drift * elapsed * spread
            off, expected = offset - mean[:6], covariance[:6, :6] + np.eye(6)
            square = float(off @ np.linalg.solve(expected, off))
            outlying = max(1.0, square / float(most[k]))
            if last is not None:
                self._sums[k] += (np.linalg.slogdet(expected)[1], square / outlying, 6.0)
            gain = np.linalg.solve(outlying * expected, covariance[:6]).T
            self._mean[k] = mean + gain @ off
            covariance = covariance - gain @ covariance[:6]
            self._covariance[k] = (covariance + covariance.T) / 2
        if self._seen:
            probable = self._probable()
            self.given = float(np.exp(probable @ np.log(self._variances())))
            self.drift = self.given * float(np.exp(probable @ np.log(_DRIFTS)))

    def _variances(self) -> NDArray[np.float64]:
        """Of the given poses, by each of the drifts."""
        return np.maximum(self._sums[:, 1] / np.maximum(self._sums[:, 2], _FEWEST), _LEAST)

    def _probable(self) -> NDArray[np.float64]:
        """Probability of each of the drifts."""
        likely = -0.5 * (self._sums[:, 0] + self._sums[:, 2] * np.log(self._variances()))
        probable = np.exp(likely - likely.max())
        return np.asarray(probable / probable.sum())

    def _lever(self, step: NDArray[np.float64]) -> NDArray[np.float64]:
        """(6, 6): what a shift and a turn at one place are at another, a step (3,) further, in stated units."""
        x, y, z = step * self._sigma[3] / self._sigma[0]
        lever = np.eye(6)
        lever[_SHIFT, _TURN] = np.array(((0, z, -y), (-z, 0, x), (y, -x, 0)))
        return lever


def _spread(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (6, 6) of a registration of this information, nearly all of it along what depth does not hold."""
    known, axes = np.linalg.eigh(information)
    return np.asarray((axes / np.maximum(known, _UNKNOWN * known[-1])) @ axes.T)
