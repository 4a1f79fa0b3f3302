"""The lattice on which a frame is fused: blocks of pixels about as large as the map's resolution."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.depth_noise import GRAZING_COS, DepthNoise
from spot3d.geometry.flying_pixels import without_flying
from spot3d.kernel import kernel
from spot3d.sensor import axial_noise_kernel

# Success rate in 40 rendered views of clutter by samples per radian: 0.48 with 131 (VGA), 0.53 with 141 (848x480, 90
# degrees across), 0.68 with 203 (848x480, 70), 0.69 with 212, 0.76 with 229 (1280x720), 0.79 with 262 (VGA), 0.82 and
# 0.84 with 305, 0.86 with 525, which takes four times as long. On Kinect's own frames (HOTS, OSD) 0.91 and 0.96 with
# 262 to 285, 0.87 and 0.96 with 525 to 570: its pixels are not as fine as that.
_FOCAL = 0.9
"""Focal length, in image widths, of Kinects, the cameras for which the rest was developed."""
_WIDEST = 1.5
"""A wide-angle camera has at most this many times `width` samples along an edge: time grows with their number."""


def block_size(camera: Intrinsics, width: int) -> int:
    """Pixels along the edge of a block.

    The whole number that brings the samples per radian nearest to those of a Kinect with `width` samples across, since
    creases and seams are found on neighbouring samples. A camera that sees a smaller angle has about `width`, too."""
    longest = max(camera.width, camera.height)
    alike = round(min(camera.fx / _FOCAL, longest) / width)
    return max(1, alike, math.ceil(longest / (_WIDEST * width)))


@dataclass(frozen=True, slots=True)
class LatticeFrame:
    """A frame reduced to one sample per block.

    colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths;
    camera: intrinsics of this lattice.
    """

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    heat: NDArray[np.uint8]
    camera: Intrinsics


def to_lattice(
    colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    heat: NDArray[np.uint8],
    camera: Intrinsics,
    width: int,
    grazing_cos: float = GRAZING_COS,
) -> LatticeFrame:
    """Reduce a frame to one sample for each block of pixels, about `width` across (see `block_size`).

    Depth is the mean of a block's pixels on its nearest surface, so that noise falls. Depth that still floats between
    two surfaces is moved to one of them or left out (`without_flying`; not if grazing_cos is 0). Colour and heat are
    those of the block's first pixel.
    """
    factor = block_size(camera, width)
    # Decoded messages are read-only views, which compiled kernels refuse.
    depth = np.require(depth, np.float32, ["C", "W"])
    if factor > 1:
        depth = _mean_of_nearest(depth, factor, camera.noise)
        camera = camera.thinned(factor, (factor - 1) / 2)
    if grazing_cos > 0:
        depth = without_flying(depth, camera.fx, grazing_cos)
    kept = np.s_[::factor, ::factor]
    colour, heat = (np.require(image[kept], requirements=["C", "W"]) for image in (colour, heat))
    return LatticeFrame(colour, depth, heat, camera)


def _mean_of_nearest(depth: NDArray[np.float32], factor: int, noise: DepthNoise) -> NDArray[np.float32]:
    """Mean of each block's valid pixels within the noise of the block's nearest; 0 where none is valid."""
    h, w = depth.shape
    small = np.zeros(((h + factor - 1) // factor, (w + factor - 1) // factor), np.float32)
    limit, count = np.empty(small.shape[1], np.float32), np.empty(small.shape[1], np.float32)
    _mean_within_noise(depth, factor, noise.coefficients(), limit, count, small)
    return small


@kernel("void(f4[:,::1], i8, UniTuple(f4, 3), f4[::1], f4[::1], f4[:,::1])")
def _mean_within_noise(
    depth: NDArray[np.float32],
    factor: int,
    noise: tuple[np.float32, np.float32, np.float32],
    limit: NDArray[np.float32],
    count: NDArray[np.float32],
    mean: NDArray[np.float32],
) -> None:
    """Write the blocks' means to `mean`, which is zero. limit, count: buffers for a row of blocks."""
    # Every loop over u does the same to all blocks of a row, so that several are computed at once.
    none, one, far = np.float32(0), np.float32(1), np.float32(np.inf)
    h, w = depth.shape
    for v in range(mean.shape[0]):
        rows = range(v * factor, min(h, v * factor + factor))
        limit[:] = far
        count[:] = none
        for y in rows:
            for x in range(factor):
                for u in range((w - x + factor - 1) // factor):
                    z = depth[y, u * factor + x]
                    nearest = z if z > none else far
                    limit[u] = nearest if nearest < limit[u] else limit[u]
        for u in range(mean.shape[1]):
            limit[u] += np.float32(0.005) * limit[u] + np.float32(4) * axial_noise_kernel(limit[u], noise)
        for y in rows:
            for x in range(factor):
                for u in range((w - x + factor - 1) // factor):
                    z = depth[y, u * factor + x]
                    near = (z > none) & (z <= limit[u]) & (z < far)
                    mean[v, u] += z if near else none
                    count[u] += one if near else none
        for u in range(mean.shape[1]):
            mean[v, u] /= max(count[u], one)
