"""What registered frames tell of what is wrong alike in all of them: depth's scale, where the camera looks.

All of it is estimated together: a principal point that is too low makes depth that is too short look true, and each
alone would take for its own what another makes. Estimated one beside the other, what is seen of two built-in desks and
two scenes of clutter, whose depth is 3 % too short and whose principal point is 16 of 640 pixels too low, lies 6 to 31
mm apart though poses are exact; together 3 to 6 (rms).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NEWS_S = 1 / 3
"""Given poses are wrong alike over a third of a second: no sooner does a frame tell something new."""
# Of so many numbers is a pose's twist, which comes first in the normal equations.
_POSE = 6


def probability(log_odds: float) -> float:
    """0..1; of any odds, without overflow."""
    return float(0.5 * (1 + np.tanh(0.5 * log_odds)))


class Registered(NamedTuple):
    """A frame that was registered to the map, and where its given pose lies.

    H (12, 12), g (12,): its normal equations for twist, scale, turn and centre, to the map as the given poses have it
    (see `SurfelMap.normal_equations`), with all that is corrected applied already, in units of independent
    information. given: (6,) twist from there to the given pose, which is known with pose_information (6, 6) against the
    map. elapsed: seconds since the last frame.
    """

    H: NDArray[np.float64]
    g: NDArray[np.float64]
    pose_information: NDArray[np.float64]
    given: NDArray[np.float64]
    elapsed: float

    def worth(self, share: float) -> "Registered":
        """The same with that share of its information."""
        return self._replace(H=share * self.H, g=share * self.g)

    @property
    def news(self) -> float:
        """Which share of what it tells is new, 0..1."""
        return min(1.0, self.elapsed / NEWS_S)


class CommonErrors:
    """Logarithm of depth's scale, turn (3,) and centre (2,) of all frames: a Kalman filter of constants.

    sigmas: (6,) standard deviation of each before anything is seen; 0: it is as was told. known: none is ever known
    better than this. estimate: (6,).
    """

    def __init__(self, sigmas: NDArray[np.float64], known: float) -> None:
        self.estimate = np.zeros(len(sigmas))
        self._free = np.flatnonzero(sigmas)
        self._sigmas, self._known = sigmas, known
        self._information = np.diag(sigmas[self._free] ** -2)

    def learn(self, frame: Registered, applied: NDArray[np.float64]) -> None:
        """Take a frame into account that was seen with these (6,) applied."""
        information, gradient = _evidence(frame, _POSE + self._free)
        total = self._information + information
        ahead = (applied - self.estimate)[self._free]
        self.estimate[self._free] += np.linalg.solve(total, gradient + information @ ahead)
        known, axes = np.linalg.eigh(total)
        self._information = (axes * np.minimum(known, self._known**-2)) @ axes.T

    def scale(self) -> tuple[float, float]:
        """Mean and variance of the logarithm of the scale: where the others are as was told, and where they are what
        fits best, each as probable as it makes what was seen (Savage and Dickey's ratio)."""
        covariance, told = np.linalg.inv(self._information), 1 / self._information[0, 0]
        if len(self._free) == 1:
            return float(self.estimate[0]), float(told)
        others = self.estimate[self._free[1:]]
        mean = self.estimate[0] + np.array((0.0, told * self._information[0, 1:] @ others))
        variance = np.array((covariance[0, 0], told))
        square = others @ np.linalg.solve(covariance[1:, 1:], others)
        narrower = np.linalg.slogdet(covariance[1:, 1:])[1] - 2 * np.log(self._sigmas[self._free[1:]]).sum()
        free = probability(0.5 * float(square + narrower))
        share = np.array((free, 1 - free))
        middle = share @ mean
        return float(middle), float(share @ (variance + (mean - middle) ** 2))

    def orientation(self, log_scale: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Turn and centre where the scale is this one: those (k,) of the five that are free, and their information."""
        first = int(0 in self._free)
        information, estimate = self._information[first:, first:], self.estimate[self._free[first:]]
        if first:
            off = log_scale - self.estimate[0]
            estimate = estimate - np.linalg.solve(information, self._information[1:, 0]) * off
        return estimate, information


def _evidence(frame: Registered, unknowns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Information (k, k) and gradient (k,) of k unknowns beside the pose, by row: its Schur complement.

    The pose may give way as far as the given one is uncertain.
    """
    H, g = frame.H, frame.g
    A, b = H[:_POSE, :_POSE] + frame.pose_information, g[:_POSE] + frame.pose_information @ frame.given
    across = H[unknowns, :_POSE]
    information = H[np.ix_(unknowns, unknowns)] - across @ np.linalg.solve(A, across.T)
    gradient = g[unknowns] - across @ np.linalg.solve(A, b)
    return frame.news * information, frame.news * gradient
