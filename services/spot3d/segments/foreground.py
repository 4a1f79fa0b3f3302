"""Foreground pixels of a single view: above the support or beside it, and on no wall, floor or ceiling."""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.depth_noise import KINECT_V1, DepthNoise
from spot3d.geometry.planes import on_plane
from spot3d.kernel import kernel
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.supports import FACING

_PIXELS = 200
"""Pieces of a plane with fewer pixels are ignored: one as long as eps_max would be a line."""
_KERNEL = np.ones((2, 2), np.uint8)


def standing_out(
    points: NDArray[np.float32],
    height: NDArray[np.float32],
    tolerance: NDArray[np.float32],
    beside: NDArray[np.bool_],
    long: NDArray[np.bool_],
    settings: SegmentsSettings,
) -> NDArray[np.bool_]:
    """(h, w) bool: valid pixels above the support by more than noise, or beside it, and on no plane longer than an
    object.

    points: (h, w, 3) float32, camera frame; height, tolerance: (h, w) float32 metres above the support, and how much
    of it may be noise (see `noise_height`); beside, long: (h, w) bool, see `beside_support` and `long_pieces`.
    """
    depth = points[..., 2]
    free = beside | (height > tolerance)
    return _opened((depth > 0) & (depth <= settings.range_max) & free & ~long)


def long_pieces(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    off: NDArray[np.bool_],
    plane: NDArray[np.float64],
    settings: SegmentsSettings,
    noise: DepthNoise = KINECT_V1,
) -> NDArray[np.bool_]:
    """(h, w) bool: pixels on connected pieces of a plane that are longer than an object, with normals like its own.

    points, normals: (h, w, 3) float32, camera frame; off: (h, w) bool, pixels off the support; plane: (4,). Pixels of
    the support connect nothing: where it is bent, a plane through a part of it and through a laptop on it is none.
    """
    facing = normals @ plane[:3].astype(np.float32) > FACING
    on = on_plane(plane, points, settings, noise) & facing & off
    count, pieces = cv2.connectedComponents(on.astype(np.uint8), connectivity=4)
    piece = np.asarray(pieces, np.int32)
    pixels = np.bincount(piece.ravel(), minlength=count)
    looked_at = pixels >= _PIXELS
    looked_at[0] = False  # pixels on no piece
    sums = np.zeros((count, 9))
    _add_up(piece, points, looked_at, sums)
    sums /= np.maximum(pixels, 1)[:, None]
    mean, square = sums[:, :3], sums[:, (3, 4, 5, 4, 6, 7, 5, 7, 8)]
    axes = np.linalg.eigh(square.reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None, :])[1][:, :, 1:]
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    _reach(piece, points, looked_at, np.ascontiguousarray(axes), low, high)
    long = looked_at & ((high - low).max(axis=1) > settings.size_max)
    return np.asarray(long.take(piece))


@kernel("void(i4[:,::1], f4[:,:,::1], b1[::1], f8[:,::1])")
def _add_up(
    piece: NDArray[np.int32], points: NDArray[np.float32], looked_at: NDArray[np.bool_], sums: NDArray[np.float64]
) -> None:
    """The sums of x, y, z, xx, xy, xz, yy, yz and zz over the points of each piece that is looked at."""
    h, w = piece.shape
    for v in range(h):
        for u in range(w):
            k = piece[v, u]
            if looked_at[k]:
                x, y, z = np.float64(points[v, u, 0]), np.float64(points[v, u, 1]), np.float64(points[v, u, 2])
                sums[k, 0], sums[k, 1], sums[k, 2] = sums[k, 0] + x, sums[k, 1] + y, sums[k, 2] + z
                sums[k, 3], sums[k, 4], sums[k, 5] = sums[k, 3] + x * x, sums[k, 4] + x * y, sums[k, 5] + x * z
                sums[k, 6], sums[k, 7], sums[k, 8] = sums[k, 6] + y * y, sums[k, 7] + y * z, sums[k, 8] + z * z


@kernel("void(i4[:,::1], f4[:,:,::1], b1[::1], f8[:,:,::1], f8[:,::1], f8[:,::1])")
def _reach(
    piece: NDArray[np.int32],
    points: NDArray[np.float32],
    looked_at: NDArray[np.bool_],
    axes: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> None:
    """The smallest and the largest coordinate of each piece's points along its own two axes, (n, 3, 2)."""
    h, w = piece.shape
    for v in range(h):
        for u in range(w):
            k = piece[v, u]
            if looked_at[k]:
                for axis in range(2):
                    along = np.float64(0)
                    for i in range(3):
                        along += points[v, u, i] * axes[k, i, axis]
                    low[k, axis], high[k, axis] = min(low[k, axis], along), max(high[k, axis], along)


def _opened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask without what is narrower than two pixels: single pixels of noise and of glare."""
    eroded = cv2.erode(mask.astype(np.uint8), _KERNEL, anchor=(0, 0))
    return np.asarray(cv2.dilate(eroded, _KERNEL, anchor=(1, 1)) > 0) & mask
