"""A depth camera, for kernels."""

from typing import NamedTuple

import numpy as np

from spot3d.camera import Intrinsics
from spot3d.kernel import kernel


class Pinhole(NamedTuple):
    """Intrinsics in single precision, pixels, and the noise of the depth: `DepthNoise.coefficients`."""

    fx: np.float32
    fy: np.float32
    cx: np.float32
    cy: np.float32
    noise: tuple[np.float32, np.float32, np.float32]


def pinhole(camera: Intrinsics) -> Pinhole:
    """The camera of these intrinsics."""
    fx, fy, cx, cy = (np.float32(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy))
    return Pinhole(fx, fy, cx, cy, camera.noise.coefficients())


@kernel("f4(f4, UniTuple(f4, 3))")
def axial_noise_kernel(z: np.float32, noise: tuple[np.float32, np.float32, np.float32]) -> np.float32:
    """Standard deviation of one depth, metres. noise: `DepthNoise.coefficients`."""
    floor, growth, at = noise
    return floor + growth * (z - at) ** 2
