"""How noisy the given poses are, as the registrations of their frames show."""

import numpy as np
from numpy.typing import NDArray

SETTLING_S = 3.0
"""Settling time of the given poses' mean and of their noise, seconds: many times the correlation time of their errors,
a third of a second. From 2 to 6 the results are the same."""
# Least information of a direction, in units of the stated uncertainty.
_UNKNOWN = 1e-6
# Offsets are clipped at this many standard deviations.
_OUTLIER = 3.0


class MeasuredNoise:
    """Variance of the given poses relative to the stated one: exact poses shall stay unchanged.

    Registrations scatter about the given poses by the noise of both (covariance matching, Mehra 1970). A lasting offset
    counts as well: poses that drift disagree with the map more and more.

    negligible: variance, in units of the stated one, below which the given poses count as exact.
    """

    def __init__(self, negligible: float) -> None:
        self.negligible = negligible
        self._count = 0
        # Poses count as exact until they are measured not to be.
        self._variance = 0.0

    def measured(self, offset: NDArray[np.float64], information: NDArray[np.float64], elapsed: float) -> float:
        """Variance of the given poses, 0..1 of the stated one, updated by this frame.

        offset: (6,) from the given pose to the registered one, information: (6, 6) of the registration; both in units
        of the stated standard deviations; elapsed: seconds since the last frame.
        """
        self._count += 1
        gain = max(1 - np.exp(-elapsed / SETTLING_S), 1 / (self._count + 1))
        known, axes = np.linalg.eigh(information)
        spread = 1 / np.maximum(known, _UNKNOWN)
        # The best known directions of the registration weigh most. Clipping limits a single registration that fails.
        expected = spread + max(self._variance, self.negligible)
        weight = 1 / expected**2
        square = np.minimum((axes.T @ offset) ** 2, _OUTLIER**2 * expected)
        excess = float(weight @ (square - spread) / weight.sum())
        self._variance += gain * (excess - self._variance)
        return float(np.clip(self._variance - self.negligible, 0.0, 1.0))
