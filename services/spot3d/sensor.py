"""What a depth camera can know: axial noise as a function of range."""

from typing import TypeVar

import numba as nb
import numpy as np
from numpy.typing import NDArray

Metres = TypeVar("Metres", float, NDArray[np.float32])


def axial_noise(z: Metres) -> Metres:
    """Standard deviation of depth z, metres (Nguyen et al. 2012, Kinect v1; the same law fits other sensors).

    It is 1.2 mm at 0.4 m and grows with the square of the range beyond.
    """
    return 0.0012 + 0.0019 * (z - 0.4) ** 2


@nb.njit("f4(f4)", cache=True, nogil=True)
def axial_noise_kernel(z: np.float32) -> np.float32:
    """`axial_noise` of one depth, for kernels."""
    return np.float32(0.0012) + np.float32(0.0019) * (z - np.float32(0.4)) ** 2
