"""What a depth camera can know: axial noise as a function of range."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from spot3d.kernel import kernel

# Axial noise of the Kinect v1 (Nguyen, Izadi, Lovell 2012), quantisation included; the same law fits other sensors:
# metres at SIGMA_AT metres, and metres per square metre beyond.
SIGMA_0, SIGMA_2, SIGMA_AT = 0.0012, 0.0019, 0.4

Metres = TypeVar("Metres", float, NDArray[np.float32], NDArray[np.float64])


def axial_noise(z: Metres) -> Metres:
    """Standard deviation of depth z, metres: 1.2 mm at 0.4 m, growing with the square of the range beyond."""
    return SIGMA_0 + SIGMA_2 * (z - SIGMA_AT) ** 2


@kernel("f4(f4)")
def axial_noise_kernel(z: np.float32) -> np.float32:
    """`axial_noise` of one depth, for kernels."""
    return np.float32(SIGMA_0) + np.float32(SIGMA_2) * (z - np.float32(SIGMA_AT)) ** 2
