"""Noise of the given poses, drift of odometry, and the scale between them, estimated from their differences.

Given poses (motion capture, a robot's own odometry, late stamps) have errors of constant size, correlated over a
moment. Odometry on depth is accurate from frame to frame, drifts, and has depth's scale. Its drift is not known
beforehand: each camera bends depth in its own way, and scenes constrain odometry well or badly. A bank of Kalman
filters (Magill 1965) therefore tries several drifts, each relative to the given poses' noise, and weighs them by how
well they predict the given poses. The innovations give the noise, and the seventh state is the scale.
"""

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.motion import twist

# With half of `_MEMORY_S`, and with twice of it and of `_OUTLIER`, views of a desk, clutter and redkitchen (poses
# shaken by 10 mm, depth 3 % too short) lie within 0.4 mm as far apart.
# Time between comparisons of given poses, seconds, so that their errors are nearly independent (correlated by a
# twentieth). With half a second and two, views of redkitchen lie 17 and 18 mm apart, not 15.5, the others as far.
_APART_S = 1.0
# Time constant with which observations are forgotten, seconds.
_MEMORY_S = 30.0
# Drifts that are tried: variance a second, in units of that of a registration whose surface is worth one point of
# independent noise, over the given poses', in units of the stated one. Rendered desks whose poses are off by 10 mm have
# the least, redkitchen and TUM fr3/cabinet 0.1 to 1, redkitchen with its own poses the most.
_DRIFTS = 10.0 ** np.arange(-2, 3)
# Differences are clipped at this many standard deviations: a given pose that jumps tells nothing of the others.
_OUTLIER = 3.0
# Least count of observations, as after a long pause; they still tell the noise of the poses.
_FEWEST = 1e-9
# Variance of unknown states at first, in units of the given poses'; and least variance of the given poses.
_ANY, _LEAST = 1e4, 1e-6
# Least information of a direction, relative to the best known one. It keeps the inverse finite along a bare plane, and
# is below the 2e-4 that real and rendered scenes have at least (`correction._HELD`).
_UNKNOWN = 1e-6
_SHIFT, _TURN, _SCALE = slice(0, 3), slice(3, 6), 6


class ErrorModel:
    """Estimates noise, drift and scale along the way.

    sigma: (6,) stated standard deviation of given poses, metres and radians. given: variance of the given poses, in
    units of the stated one; drift: variance that odometry gains in a second, in units of that of a registration whose
    surface is worth one point of independent noise; both 0 before they are known.
    """

    def __init__(self, sigma: NDArray[np.float64]) -> None:
        self.given = self.drift = 0.0
        self._sigma = sigma
        # By drift: shift and turn of the given pose against odometry's, in stated units, and the logarithm of the
        # scale, in those of the shift a metre; and its covariance over the variance of the given poses.
        self._mean = np.zeros((len(_DRIFTS), 7))
        self._covariance = np.tile(_ANY * np.eye(7), (len(_DRIFTS), 1, 1))
        # By drift, sums over innovations: log determinant of their covariance, squared norm by it, and dimensions.
        self._sums = np.zeros((len(_DRIFTS), 3))
        # Of the last comparison: time (seconds), and pose (4, 4) in the map by odometry.
        self._last: tuple[float, NDArray[np.float64]] | None = None

    def learn(
        self,
        time_s: float,
        T_map_odometry: NDArray[np.float64],
        T_map_given: NDArray[np.float64],
        information: NDArray[np.float64],
    ) -> float:
        """Update with a frame's poses (4, 4), by odometry and given, both in the map; returns `drift`.

        information: (6, 6) of its registration, map axes, in units of the stated uncertainty, if its surface were worth
        one point of independent noise.
        """
        offset = twist(T_map_odometry, T_map_given) / self._sigma
        if self._last is None or time_s - self._last[0] >= _APART_S:
            self._foretell(time_s, T_map_odometry, offset, _spread(information))
        return self.drift

    def rescaled(self, factor: float) -> None:
        """Adapt to depth that is `factor` times as large from here on."""
        self._mean[:, _SCALE] -= np.log(factor) / self._sigma[0]

    def interrupt(self) -> None:
        """Forget the offset between given poses and odometry: the former have jumped, or the latter begins anew."""
        self._last = None
        pose = slice(0, 6)
        self._covariance[:, pose, :] = self._covariance[:, :, pose] = 0
        self._covariance[:, pose, pose] = _ANY * np.eye(6)

    @property
    def _seen(self) -> float:
        """How many numbers were predicted, older ones counting less."""
        return float(self._sums[0, 2])

    def _foretell(
        self, time_s: float, pose: NDArray[np.float64], offset: NDArray[np.float64], spread: NDArray[np.float64]
    ) -> None:
        """Predict the given pose by each of the filters, and update them with the innovation."""
        last, self._last = self._last, (time_s, pose)
        transition, elapsed = np.eye(7), 0.0
        if last is not None:
            elapsed, step = time_s - last[0], pose[:3, 3] - last[1][:3, 3]
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
        """Variance of the given poses by each of the drifts."""
        return np.maximum(self._sums[:, 1] / np.maximum(self._sums[:, 2], _FEWEST), _LEAST)

    def _probable(self) -> NDArray[np.float64]:
        """Probability of each of the drifts."""
        likely = -0.5 * (self._sums[:, 0] + self._sums[:, 2] * np.log(self._variances()))
        probable = np.exp(likely - likely.max())
        return np.asarray(probable / probable.sum())

    def _lever(self, step: NDArray[np.float64]) -> NDArray[np.float64]:
        """(6, 6) map of a shift and a turn at one place to those at a place a step (3,) further, in stated units."""
        x, y, z = step * self._sigma[3] / self._sigma[0]
        lever = np.eye(6)
        lever[_SHIFT, _TURN] = np.array(((0, z, -y), (-z, 0, x), (y, -x, 0)))
        return lever


def _spread(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (6, 6) of a registration of this information; it is largest in directions depth does not constrain."""
    known, axes = np.linalg.eigh(information)
    return np.asarray((axes / np.maximum(known, _UNKNOWN * known[-1])) @ axes.T)
