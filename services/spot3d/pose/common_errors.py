"""What is wrong alike in all frames, as far as they tell: depth's scale, where the camera looks."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

COMMON = 6
"""Logarithm of depth's scale, turn (3,) and centre (2,): so many numbers."""
_ODDS = 0.5
"""Odds that a camera is not as it says, before anything was seen: of three one is not."""


class CommonErrors(NamedTuple):
    """Estimate (6,); which of them are free: (k,), the others are as was told; of these the information (k, k), with
    that of how uncertain each was before anything was seen, sigmas: (k,). share: of what was seen so much is trusted.
    """

    estimate: NDArray[np.float64]
    free: NDArray[np.int64]
    information: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    share: float = 1.0


def believed(
    values: NDArray[np.float64], information: NDArray[np.float64], sigmas: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    """What is to be applied of these (k,): what is most probable where they are not zero, times the probability that
    they are not, or nothing where that is less than half.

    Either is as probable as what was seen is by it (Bayes factor of a spike and a slab: Mitchell and Beauchamp 1988).
    information: (k, k); sigmas, share: see `CommonErrors`.
    """
    slab = np.diag(sigmas**-2.0)
    trusted, pull = slab + share * (information - slab), share * information @ values
    probable = np.linalg.solve(trusted, pull)
    narrower = float(np.linalg.slogdet(trusted)[1]) + 2 * float(np.log(sigmas).sum())
    log_odds = 0.5 * (float(pull @ probable) - narrower) + float(np.log(_ODDS))
    probability = 0.5 * (1 + np.tanh(0.5 * log_odds)) if log_odds > 0 else 0.0
    return np.asarray(probability * probable)
