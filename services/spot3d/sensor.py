"""The noise of a depth camera, for kernels."""

import numpy as np

from spot3d.kernel import kernel


@kernel("f4(f4, UniTuple(f4, 3))")
def axial_noise_kernel(z: np.float32, noise: tuple[np.float32, np.float32, np.float32]) -> np.float32:
    """Standard deviation of one depth, metres. noise: `DepthNoise.coefficients`."""
    floor, growth, at = noise
    return floor + growth * (z - at) ** 2
