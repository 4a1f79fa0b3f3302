"""The lattice on which a frame is fused: blocks of pixels about as large as what the map resolves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.kernel import kernel
from spot3d.sensor import axial_noise_kernel


@dataclass(frozen=True, slots=True)
class LatticeFrame:
    """A frame reduced to one sample a block.

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
) -> LatticeFrame:
    """Reduce a frame by the whole factor that brings it nearest to `width` pixels across.

    Depth is the mean of a block's pixels on its nearest surface: noise falls and no point floats between two
    surfaces. Colour and heat are the block's first pixel's.
    """
    factor = max(1, round(camera.width / width))
    # Decoded messages are read-only views, which compiled kernels refuse.
    depth = np.require(depth, np.float32, ["C", "W"])
    if factor == 1:
        return LatticeFrame(
            np.require(colour, requirements=["C", "W"]), depth, np.require(heat, requirements=["C", "W"]), camera
        )
    small = _mean_of_nearest(depth, factor)
    shift = (factor - 1) / 2
    h, w = small.shape
    lattice = Intrinsics(
        camera.fx / factor,
        camera.fy / factor,
        (camera.cx - shift) / factor,
        (camera.cy - shift) / factor,
        w,
        h,
    )
    return LatticeFrame(
        np.ascontiguousarray(colour[::factor, ::factor]),
        small,
        np.ascontiguousarray(heat[::factor, ::factor]),
        lattice,
    )


@kernel("f4[:,::1](f4[:,::1], i8)")
def _mean_of_nearest(depth: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Mean of each block's valid pixels within the noise of the block's nearest; 0 where none is valid."""
    h, w = depth.shape
    small = np.zeros(((h + factor - 1) // factor, (w + factor - 1) // factor), np.float32)
    for v in range(small.shape[0]):
        rows = range(v * factor, min(h, v * factor + factor))
        for u in range(small.shape[1]):
            columns = range(u * factor, min(w, u * factor + factor))
            nearest = np.float32(np.inf)
            for y in rows:
                for x in columns:
                    if depth[y, x] > 0:
                        nearest = min(nearest, depth[y, x])
            if nearest == np.inf:
                continue
            limit = nearest + np.float32(0.005) * nearest + np.float32(4) * axial_noise_kernel(nearest)
            total, count = np.float32(0), 0
            for y in rows:
                for x in columns:
                    if 0 < depth[y, x] <= limit:
                        total += depth[y, x]
                        count += 1
            small[v, u] = total / count
    return small
